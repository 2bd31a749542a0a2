# SPDX-License-Identifier: Apache-2.0
"""Records topics as serialised messages, and converts them to arrays after the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile

from kalman_ros.codecs.signal_codecs import Codec, codec_of
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array, Signal
from kalman_ros.nodes.middleware.watcher import WatcherNode

from .run_recording import RunRecording

#: Deep enough for the messages between two reads.
QUEUE = QoSProfile(depth=100_000)


@dataclass(frozen=True)
class Recorded:
    """A topic as arrays.

    Parameters
    ----------
    stamp
        Of each message (N,), in nanoseconds; empty if the type has no header.
    values
        The fields of the topic's signal (N, k).
    covariance
        Of the fields, (N, k, k), where the type has it; else None.
    """

    stamp: Any
    values: Array
    covariance: Array | None


class Recorder:
    """Watches signals on a node and keeps the bytes of every message."""

    def __init__(self, node: WatcherNode, signals: Mapping[str, Signal]) -> None:
        self._codecs: dict[str, Codec] = {}
        self.raw: dict[str, list[bytes]] = {}
        #: The number of messages received, by the full name of the topic; `forget` keeps them.
        self.received: dict[str, int] = {}
        self._subscriptions: list[Any] = []
        self._intake = node.intake
        self.on_message: Callable[[str, bytes], None] = lambda topic, data: None
        #: Where the messages are written to, beside.
        self.recording: RunRecording | None = None
        for topic, signal in signals.items():
            codec = self._codecs[topic] = codec_of(signal)
            self.raw[topic] = []
            full = node.resolve_topic_name(topic)
            self.received[full] = 0
            keep = partial(self._keep, topic, full, self.raw[topic])
            self._subscriptions.append(node.watch(codec.message_type, topic, keep, QUEUE))

    def _keep(self, topic: str, full: str, messages: list[bytes], data: bytes) -> None:
        messages.append(data)
        self.received[full] += 1
        self.on_message(topic, data)
        if self.recording is not None:
            self.recording.write(full, data)

    def write_to(self, recording: RunRecording) -> None:
        """Write all messages from now on into a recording, too."""
        for subscription in self._subscriptions:
            recording.add(subscription)
        self.recording = recording

    @property
    def topics(self) -> list[str]:
        """The full names of the recorded topics."""
        return [subscription.topic_name for subscription in self._subscriptions]

    def count(self) -> int:
        """Return the number of messages received, on all topics."""
        return sum(self.received.values())

    def missing(self, published: Mapping[str, int]) -> dict[str, tuple[int, int]]:
        """Return the numbers received and published for each topic with missing messages.

        Parameters
        ----------
        published
            The number of messages published, by the full name of the topic.
        """
        return {
            topic: (count, published[topic])
            for topic, count in self.received.items()
            if count < published.get(topic, 0)
        }

    def forget(self) -> None:
        """Drop all records, to limit the memory of a long run."""
        for messages in self.raw.values():
            messages.clear()

    def __getitem__(self, topic: str) -> Recorded:
        """Return the record of ``topic``; KeyError if there is none."""
        codec = self._codecs[topic]
        read = WireReader(codec)
        found = (self._intake(topic, read, data) for data in self.raw[topic])
        samples = [sample for sample in found if sample is not None]
        stamps = [sample.time for sample in samples if sample.time is not None]
        covariances = [sample.covariance for sample in samples]
        return Recorded(
            np.array(stamps, dtype=np.int64),
            np.array([sample.values for sample in samples]).reshape(-1, codec.size),
            np.array(covariances) if codec.carries_covariance else None,
        )
