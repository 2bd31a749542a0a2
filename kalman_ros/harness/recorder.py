# SPDX-License-Identifier: Apache-2.0
"""Gathers topics as they are on the wire, and turns them into arrays when the run is over."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile

from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array, Signal
from kalman_ros.nodes.watcher import WatcherNode

#: Deep enough for whatever comes while nobody looks.
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
        Of the fields, (N, k, k), where the type carries it; else None.
    """

    stamp: Any
    values: Array
    covariance: Array | None


class Recorder:
    """Watches signals on a node and keeps the bytes of every message."""

    def __init__(self, node: WatcherNode, signals: Mapping[str, Signal]) -> None:
        self._codecs: dict[str, SignalCodec] = {}
        self.raw: dict[str, list[bytes]] = {}
        #: How many messages have come, by the full name of the topic; `forget` keeps them.
        self.received: dict[str, int] = {}
        self._subscriptions: list[Any] = []
        self._intake = node.intake
        self.on_message: Callable[[str, bytes], None] = lambda topic, data: None
        for topic, signal in signals.items():
            codec = self._codecs[topic] = SignalCodec(signal)
            self.raw[topic] = []
            full = node.resolve_topic_name(topic)
            self.received[full] = 0
            keep = partial(self._keep, topic, full, self.raw[topic])
            self._subscriptions.append(node.watch(codec.message_type, topic, keep, QUEUE))

    def _keep(self, topic: str, full: str, messages: list[bytes], data: bytes) -> None:
        messages.append(data)
        self.received[full] += 1
        self.on_message(topic, data)

    @property
    def topics(self) -> list[str]:
        """The full names of the topics that it listens to."""
        return [subscription.topic_name for subscription in self._subscriptions]

    def count(self) -> int:
        """Return how many messages have come, of all topics."""
        return sum(self.received.values())

    def missing(self, published: Mapping[str, int]) -> dict[str, tuple[int, int]]:
        """Return received and published of each topic of which less came than was published.

        Parameters
        ----------
        published
            How many messages were published, by the full name of the topic.
        """
        return {
            topic: (count, published[topic])
            for topic, count in self.received.items()
            if count < published.get(topic, 0)
        }

    def forget(self) -> None:
        """Drop all records, so that a long run does not fill the memory."""
        for messages in self.raw.values():
            messages.clear()

    def __getitem__(self, topic: str) -> Recorded:
        """Return what came on ``topic``; KeyError if it was not recorded."""
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
