# SPDX-License-Identifier: Apache-2.0
"""Topics that several nodes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_topic_name import validate_topic_name

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.messages import message_type
from kalman_ros.core import Signal
from kalman_ros.pipeline.input_messages import InputDecoder
from kalman_ros.scenario import Scenario

from .host import Host

#: Reliable, with a depth for about a second without processor time. A queue drops messages
#: silently; a reader with too much to read drops and counts them itself.
QUEUE = QoSProfile(depth=5000)
#: Questions, of which a flood must hold up nothing else: the oldest of more are dropped.
QUESTIONS = QoSProfile(depth=100)

#: For writers: a depth for what a lockstep recorder misses in that time. A message that a writer
#: has dropped cannot be sent again.
HISTORY = QoSProfile(depth=1000)


#: For what is published once: later subscribers receive it, too.
KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

#: For ``/tf``, as tf2 has it.
TRANSFORMS = QoSProfile(depth=100)

#: For ``/tf_static``, as tf2 has it: each node that places frames has published once.
STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def sensor_queue(*, reliable: bool) -> QoSProfile:
    """Return the quality of service of a sensor's subscription; best effort takes any."""
    policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=QUEUE.depth, reliability=policy)


#: For monitoring: losses have no effect on other nodes.
WATCH = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def watched(
    node: Host, signal: Signal, take: Callable[[Sample], None], warn: Callable[[str], object]
) -> Any:
    """Subscribe to a signal for monitoring; messages that cannot be read are only named."""
    read = InputDecoder(signal)

    def on_message(data: bytes) -> None:
        try:
            take(read(data))
        except (LookupError, ValueError):
            warn(f'{signal.topic}: a message cannot be read')

    return node.watch(read.message_type, signal.topic, on_message, WATCH)


def on_topic(signal: Signal, topic: str) -> Signal:
    """Return the same fields on another topic."""
    return replace(signal, topic=topic)


def check(scenario: Scenario, node: str, namespace: str) -> None:
    """Raise ValueError if a topic of a scenario cannot be one, or a state would have no stamp."""
    sensors = {name: source.signal for name, source in scenario.sensors.items()}
    for name, signal in {'state': scenario.state, 'input': scenario.input, **sensors}.items():
        try:
            validate_topic_name(signal.topic)
            validate_full_topic_name(expand_topic_name(signal.topic, node, namespace))
        except (InvalidTopicNameException, ValueError):
            expected = 'expected the name of a topic'
            raise ValueError(f"{name}.topic: {expected}, got '{signal.topic}'") from None
    if not hasattr(message_type(scenario.state.type), 'header'):
        expected = f"expected a message with a header, got '{scenario.state.type}'"
        raise ValueError(f'state.type: {expected}, which has no stamp')


def refuse_shared(scenario: Scenario) -> None:
    """Raise ValueError if sensors share a topic: a simulated message has only one of them."""
    users: dict[str, str] = {}
    for name, source in scenario.enabled.items():
        other = users.setdefault(source.signal.topic, name)
        if other != name:
            why = f"sensor {other} is on '{source.signal.topic}', too, which is not simulated"
            raise ValueError(f'{name}.topic: {why}')
