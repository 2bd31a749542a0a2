# SPDX-License-Identifier: Apache-2.0
"""Parts of a recording of lockstep, by the time of its ticks."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros.bags.blocks import Message
from kalman_ros.bags.steps import Steps
from kalman_ros.codecs.tick import write_tick

SECOND = 1_000_000_000
BEGIN = 7 * SECOND


def messages():
    """Return five steps a second apart, each recorded within a millisecond."""
    found = []
    for step in range(5):
        time = 1_000_000 * step
        found.append(Message(time + 1, '/y', bytes([step])))
        found.append(Message(time + 2, '/tick', write_tick(BEGIN + step * SECOND, ('y',))))
        found.append(Message(time + 3, '/force', bytes([step])))
    return found


def test_the_part_is_that_of_simulated_time():
    steps = Steps(messages(), '/tick', 1.5, 3.0)
    read = [message.data[0] for message in steps if message.topic == '/y']
    assert read == [2, 3]
    assert steps.origin == BEGIN


def test_without_limits_all_is_there_and_the_last_answer():
    assert list(Steps(messages(), '/tick')) == messages()


def test_a_step_has_the_input_before_it():
    topics = [message.topic for message in Steps(messages(), '/tick', 1.0, 1.0)]
    assert topics == ['/force', '/y', '/tick']


def test_a_tick_that_is_none_ends_nothing():
    broken = [Message(0, '/tick', b'\0\1'), *messages()]
    assert list(Steps(broken, '/tick')) == broken
