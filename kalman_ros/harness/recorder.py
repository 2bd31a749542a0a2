# SPDX-License-Identifier: Apache-2.0
"""Gathers topics as they are on the wire, and turns them into arrays when the run is over."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from kalman_ros.codecs.messages import stamp_of
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.core import Array, Signal

#: Deep enough for whatever comes while nobody looks.
_QUEUE = QoSProfile(depth=100_000)
#: A serialised message with a header begins with a CDR header and the stamp: seconds, rest.
_STAMP = struct.Struct('<4xiI')


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
    """Subscribes to signals on a node and keeps the bytes of every message."""

    def __init__(self, node: Any, signals: Mapping[str, Signal]) -> None:
        self._codecs: dict[str, SignalCodec] = {}
        self.raw: dict[str, list[bytes]] = {}
        self._subscriptions: list[Any] = []
        self.on_message: Callable[[str, bytes], None] = lambda topic, data: None
        for topic, signal in signals.items():
            codec = self._codecs[topic] = SignalCodec(signal)
            self.raw[topic] = []
            keep = partial(self._keep, topic, self.raw[topic])
            self._subscriptions.append(
                node.create_subscription(codec.message_type, topic, keep, _QUEUE, raw=True)
            )

    def _keep(self, topic: str, messages: list[bytes], data: bytes) -> None:
        messages.append(data)
        self.on_message(topic, data)

    @property
    def topics(self) -> list[str]:
        """The full names of the topics that it listens to."""
        return [subscription.topic_name for subscription in self._subscriptions]

    def count(self) -> int:
        """Return how many messages have come, of all topics."""
        return sum(len(messages) for messages in self.raw.values())

    def __getitem__(self, topic: str) -> Recorded:
        """Return what came on ``topic``; KeyError if it was not recorded."""
        codec = self._codecs[topic]
        messages = [deserialize_message(data, codec.message_type) for data in self.raw[topic]]
        values = [codec.decode(message) for message in messages]
        covariances = [codec.decode_covariance(message) for message in messages]
        stamps = [stamp for message in messages if (stamp := stamp_of(message)) is not None]
        return Recorded(
            np.array(stamps, dtype=np.int64),
            np.array(values).reshape(-1, codec.size),
            np.array(covariances) if codec.carries_covariance else None,
        )


def leading_stamp(data: bytes) -> int:
    """Return the stamp of a serialised message whose type begins with a header, in ns."""
    seconds, rest = _STAMP.unpack_from(data)
    return int(seconds) * 1_000_000_000 + int(rest)
