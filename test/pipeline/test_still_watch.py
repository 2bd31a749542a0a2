# SPDX-License-Identifier: Apache-2.0
"""When a body stands still, by its messages; and which readings are made of them."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from kalman_ros import scenario
from kalman_ros.codecs.messages import write_stamp
from kalman_ros.core import Signal
from kalman_ros.core.still import StandStill
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.pipeline.reading_reader import SensorReader
from kalman_ros.pipeline.still_watch import StillWatch

SPEED, TURN = 'twist.twist.linear.x', 'twist.twist.angular.z'
DRIVE = {'model': 'robot_2d', 'sensors': ['rest']}
REST = {
    'rest.type': 'nav_msgs/Odometry', 'rest.measures': ['vx', 'vy', 'wz'],
    'rest.fields': [SPEED, 'twist.twist.linear.y', TURN], 'rest.noise': [0.01, 0.01, 0.01],
}  # fmt: skip
STILL = {'rest.still.below': [0.02, 0.05], 'rest.still.fields': [SPEED, TURN]}


def odometry(time, speed=0.0, turn=0.0):
    message = Odometry()
    write_stamp(message.header.stamp, round(time * 1e9))
    message.twist.twist.linear.x, message.twist.twist.angular.z = speed, turn
    message.twist.covariance[[0, 7, 35]] = 0.5
    return bytes(serialize_message(message))


@pytest.fixture
def watch():
    signal = Signal('odom', 'nav_msgs/Odometry', (SPEED,))
    found = StillWatch(signal, StandStill((SPEED, TURN), (0.02, 0.05), 0.5))
    return lambda time, *values: not found(odometry(time, *values), round(time * 1e9))


def test_it_stands_still_once_all_was_small_for_the_duration(watch):
    assert [watch(t, 0.01, -0.04) for t in (1.0, 1.3, 1.49, 1.5, 1.6)] == [False] * 3 + [True] * 2


@pytest.mark.parametrize('values', [(0.03, 0.0), (0.0, -0.06), (np.nan, 0.0), (0.0, np.inf)])
def test_one_that_is_not_small_ends_it(watch, values):
    assert [watch(t) for t in (1.0, 1.6)] == [False, True]
    assert not watch(1.7, *values)
    assert [watch(t) for t in (1.8, 2.2, 2.31)] == [False, False, True]


def test_a_late_message_of_motion_is_of_the_time_before(watch):
    assert [watch(t) for t in (1.0, 1.6)] == [False, True]
    assert not watch(0.9, 1.0)
    assert watch(1.7)


def test_silence_proves_nothing(watch):
    assert [watch(t) for t in (1.0, 1.6, 9.0, 9.4, 9.5)] == [False, True, False, False, True]


def test_a_clock_that_goes_back_starts_again(watch):
    assert [watch(t) for t in (100.0, 100.6, 1.0, 1.4, 1.5)] == [False, True, False, False, True]


def reader(values):
    source = scenario.build({**DRIVE, **REST, **values}, with_law=False).sensors['rest']
    found = SensorReader('rest', source)
    return lambda *message: found.read(odometry(*message), source)


def test_readings_of_zero_have_the_configured_noise():
    read = reader({'rest.zero': True})
    found = read(1.0, 3.0, 4.0)
    assert found.outcome is None
    assert found.covariance is None
    np.testing.assert_array_equal(found.values, np.zeros(3))


def test_while_it_moves_there_is_no_reading():
    read = reader({'rest.zero': True, **STILL})
    assert [read(t, 0.01).outcome for t in (1.0, 1.4)] == [Outcome.MOVING] * 2
    np.testing.assert_array_equal(read(1.5, 0.01).values, np.zeros(3))
    assert read(1.6, 0.5).outcome is Outcome.MOVING


def test_the_reason_is_named():
    source = scenario.build({**DRIVE, **REST, **STILL}, with_law=False).sensors['rest']
    found = SensorReader('rest', source)
    for time, speed, reason in (
        (1.0, 0.5, 'the body moves'), (1.2, 0.0, 'not at rest for still.duration yet'),
        (3.0, 0.0, 'messages more than 1 s apart'), (0.0, 0.0, 'a stamp of zero'),
    ):  # fmt: skip
        assert found.read(odometry(time, speed), source).outcome is Outcome.MOVING
        assert found.trouble.startswith(reason)


def test_without_zero_the_fields_are_read_at_rest():
    found = reader({**STILL, 'rest.still.duration': 0.0})(1.0, 0.01, 0.03)
    np.testing.assert_allclose(found.values, [0.01, 0.0, 0.03])
    np.testing.assert_allclose(found.covariance, 0.5 * np.eye(3))


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'rest.still.below': [0.1, 0.1]}, r'rest.still.below: expected one for each of twist'),
        ({**STILL, 'rest.still.below': [0.1, -1.0]}, r'expected positive sizes, got \(0.1, -1\)'),
        ({**STILL, 'rest.still.below': [0.1, float('nan')]}, r'expected a number, got nan'),
        ({'rest.still.fields': [SPEED]}, r'rest.still.fields: expected still.below beside it'),
        ({**STILL, 'rest.still.fields': [SPEED, 'wrong']}, r"'wrong'"),
        ({**STILL, 'rest.still.duration': -1.0}, r'rest.still.duration: expected 0 to 3600 s'),
        (
            {'rest.type': 'geometry_msgs/Twist', 'rest.fields': ['linear.x'] * 3,
             'rest.still.below': [0.1] * 3},
            r'still.below: expected messages with a stamp, geometry_msgs/Twist has none',
        ),
    ],
)  # fmt: skip
def test_wrong_conditions_are_refused_in_one_line(values, words):
    with pytest.raises(ValueError, match=words):
        reader(values)
