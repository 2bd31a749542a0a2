# SPDX-License-Identifier: Apache-2.0
"""Topics that several nodes use alike."""

from __future__ import annotations

from dataclasses import replace

from rclpy.qos import QoSProfile, ReliabilityPolicy

from kalman_ros.core import Signal

#: Reliable, with room for what arrives while a callback runs.
QUEUE = QoSProfile(depth=50)


def sensor_queue(*, reliable: bool) -> QoSProfile:
    """Return the quality of service of a sensor's subscription; best effort takes any."""
    policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=50, reliability=policy)


#: For those who only watch: what they lose costs the others nothing.
WATCH = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


def on_topic(signal: Signal, topic: str) -> Signal:
    """Return the same fields on another topic."""
    return replace(signal, topic=topic)
