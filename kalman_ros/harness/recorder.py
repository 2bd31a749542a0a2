# SPDX-License-Identifier: Apache-2.0
"""Recorder of topics as serialised messages, which become arrays after the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile

from kalman_ros.codecs.signal_codecs import Codec, codec_of
from kalman_ros.core import Array, Signal
from kalman_ros.nodes.middleware.watcher import WatcherNode
from kalman_ros.pipeline.input_messages import InputDecoder

from .run_recording import RunRecording

#: Queue that holds all messages between two reads.
QUEUE = QoSProfile(depth=100_000)


@dataclass(frozen=True)
class Recorded:
    """A topic as arrays.

    Parameters
    ----------
    stamp
        Stamp of each message (N,), in nanoseconds; empty if the type has no header.
    values
        Fields of the signal of the topic (N, k).
    covariance
        Covariance of the fields (N, k, k); None if the type has no covariance.
    """

    stamp: Any
    values: Array
    covariance: Array | None


class Recorder:
    """A recorder that watches signals on a node and keeps the bytes of every message."""

    def __init__(self, node: WatcherNode, signals: Mapping[str, Signal]) -> None:
        self._codecs: dict[str, Codec] = {}
        self._signals = dict(signals)
        self.raw: dict[str, list[bytes]] = {}
        #: Number of received messages by full name of the topic; `forget` does not reset it.
        self.received: dict[str, int] = {}
        self._subscriptions: list[Any] = []
        self._intake = node.intake
        self.on_message: Callable[[str, bytes], None] = lambda topic, data: None
        #: Recording into which the messages are also written.
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
        """Write all further messages into a recording, too."""
        for subscription in self._subscriptions:
            recording.add(subscription)
        self.recording = recording

    @property
    def topics(self) -> list[str]:
        """Full names of the recorded topics."""
        return [subscription.topic_name for subscription in self._subscriptions]

    def count(self) -> int:
        """Return the number of received messages on all topics."""
        return sum(self.received.values())

    def missing(self, published: Mapping[str, int]) -> dict[str, tuple[int, int]]:
        """Return the numbers of received and published messages of each incomplete topic.

        Parameters
        ----------
        published
            Number of published messages by the full name of the topic.
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
        """Return the record of ``topic``; raise KeyError if there is none."""
        codec, read = self._codecs[topic], InputDecoder(self._signals[topic])
        decoded = (self._intake.read(topic, read, data) for data in self.raw[topic])
        samples = [sample for sample in decoded if sample is not None]
        stamps = [sample.time for sample in samples if sample.time is not None]
        covariances = [sample.covariance for sample in samples]
        return Recorded(
            np.array(stamps, dtype=np.int64),
            np.array([sample.values for sample in samples]).reshape(-1, codec.size),
            np.array(covariances) if codec.carries_covariance else None,
        )
