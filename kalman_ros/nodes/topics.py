# SPDX-License-Identifier: Apache-2.0
"""Topics that several nodes use alike."""

from __future__ import annotations

from dataclasses import replace

from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_topic_name import validate_topic_name

from kalman_ros.codecs.messages import message_type
from kalman_ros.codecs.signal_codec import named
from kalman_ros.core import Signal, Space
from kalman_ros.scenario import Scenario

#: Reliable, with room for what comes while a node gets no processor time, a second or so. What
#: a queue drops, nobody is told of: whoever has too much to read drops it, and counts it.
QUEUE = QoSProfile(depth=5000)

#: For writers: room for what a watcher of lockstep misses in that time. What a writer has dropped
#: cannot be sent again.
HISTORY = QoSProfile(depth=1000)


def sensor_queue(*, reliable: bool) -> QoSProfile:
    """Return the quality of service of a sensor's subscription; best effort takes any."""
    policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=QUEUE.depth, reliability=policy)


#: For those who only watch, now and then: what they lose costs the others nothing.
WATCH = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def covariance_signal(state: Signal) -> Signal:
    """Return where the whole covariance (n, n) of an estimate is, row by row."""
    fields = tuple(f'data[{index}]' for index in range(len(state.fields) ** 2))
    return Signal(f'{state.topic}/covariance', 'std_msgs/Float64MultiArray', fields)


def innovation_signal(state: Signal, sensor: str, output: Space) -> Signal:
    """Return where a sensor's innovations are: each, each one's deviation, and their NIS."""
    names = (*output.names, *(f'{name}_std' for name in output.names), 'nis')
    return named(Signal(f'{state.topic}/innovation/{sensor}', '', ()), names)


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
