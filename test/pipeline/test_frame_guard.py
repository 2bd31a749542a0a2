# SPDX-License-Identifier: Apache-2.0
"""Which messages are of the frame of their sensor, by their bytes."""

import pytest

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64MultiArray

from kalman_ros.bags.replay import estimator_settings
from kalman_ros.codecs.messages import FRAME_START
from kalman_ros.core import Signal
from kalman_ros.core.mount import Mounting, mounting
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.pipeline.frame_guard import FrameGuard
from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.pipeline.reading_reader import InputReader

RATE, PLACE, TWIST = 'angular_velocity.z', 'pose.pose.position.x', 'twist.twist.linear.x'
OWN = ('map', 'base_link')


def message(kind, frame, child=''):
    found = kind()
    found.header.frame_id = frame
    if child:
        found.child_frame_id = child
    return bytes(serialize_message(found))


def guard(kind, *fields, **mounting):
    said = []
    signal = Signal('a', '', fields, mounting=Mounting(**mounting))
    return FrameGuard(signal, kind, OWN, said.append), said


def test_a_declared_frame_is_compared_and_never_announced():
    check, said = guard(Imu, RATE, frame='imu_link')
    frames = ['imu_link', '/imu_link', 'imu_lin', 'imu_link2', '', 'imu_link', 'é' * 40]
    found = [check(message(Imu, frame)) for frame in frames]
    assert [not each for each in found] == [True, True, False, False, True, True, False]
    assert found[3] == "expected frame 'imu_link', got 'imu_link2'"
    assert not said


def test_the_first_frame_counts_where_none_is_declared():
    check, said = guard(Imu, RATE)
    assert not check(message(Imu, 'imu_link'))
    assert not check(message(Imu, 'imu_link'))
    assert check(message(Imu, 'other')) == "expected frame 'imu_link', got 'other'"
    assert said == ["frame 'imu_link' is taken for base_link; declare frame and mount to be sure"]


@pytest.mark.parametrize(
    ('frame', 'mounting', 'meant'),
    [
        ('odom', {}, 'map'),
        ('map', {}, ''),
        ('base_link', {}, ''),
        ('', {}, ''),
        ('odom', {'placed': True}, ''),
    ],
)
def test_a_frame_is_announced_unless_it_is_clear(frame, mounting, meant):
    check, said = guard(Odometry, PLACE, **mounting)
    check(message(Odometry, frame, 'wheels'))
    assert bool(said) == bool(meant)
    assert all(f'is taken for {meant};' in each for each in said)


@pytest.mark.parametrize(
    ('rotation', 'translation', 'placed'),
    [
        ((0, 0, 1.5), (0, 0, 0), True),
        ((0, 0, 0), (1.0, 0, 0), True),
        ((0, 0, 0), (0, 0, 0), False),
    ],
)
def test_a_sensor_is_placed_by_its_rotation_or_its_place(rotation, translation, placed):
    assert mounting(rotation, 'enu', '', translation).placed is placed


def test_a_twist_of_an_odometry_is_in_its_child_frame():
    for frame in ('a', 'ab', 'abc', 'abcd', 'abcde'):  # whatever the padding between the strings
        check, _ = guard(Odometry, TWIST, frame='base_link')
        assert not check(message(Odometry, frame, 'base_link'))
        assert not check(message(Odometry, frame, 'base_link'))
        other = check(message(Odometry, frame, 'wheel'))
        assert other == "expected frame 'base_link', got 'wheel'"
        both, _ = guard(Odometry, TWIST, PLACE, frame=frame)
        assert not both(message(Odometry, frame, 'wheel'))


def test_a_message_without_a_header_has_no_frame():
    check, said = guard(Float64MultiArray, 'data[0]', frame='imu_link')
    assert not check(bytes(serialize_message(Float64MultiArray())))
    assert not said


def test_an_input_of_another_frame_than_declared_is_counted_and_named():
    said = []
    found = estimator_settings('inertial', {'input.frame': 'imu_link'})
    reader = InputReader(found.scenario.input, OWN, said.append)
    fuser = Fuser(found.scenario, found.estimator(), {}, reader, said.append)
    assert fuser.read_input(message(Imu, 'imu_link')) is not None
    assert fuser.read_input(message(Imu, 'camera')) is None
    assert fuser.inputs == {Outcome.OTHER_FRAME: 1}
    assert said == [
        "imu dropped: in another frame than declared: expected frame 'imu_link', got 'camera'"
    ]


def test_an_input_of_no_declared_frame_is_used_whatever_its_frame():
    """Controllers name frames of their own; a first one that is unclear is named."""
    said = []
    found = estimator_settings('inertial')
    reader = InputReader(found.scenario.input, OWN, said.append)
    for frame in ('imu_link', 'base_link', ''):
        assert reader.read(message(Imu, frame)).values.size == 6
    assert said == [
        "input: frame 'imu_link' is taken for base_link; declare frame and mount to be sure"
    ]


def test_messages_without_a_child_frame_are_known_by_their_bytes():
    check, said = guard(Odometry, TWIST)
    empty = message(Odometry, 'odom')
    assert not check(empty)
    assert empty.startswith(check.accepted, FRAME_START)
    assert not check(message(Odometry, 'odom', 'wheels')) and len(said) == 1
    assert check(message(Odometry, 'odom', 'arm')) == "expected frame 'wheels', got 'arm'"
    assert not check(empty)
    assert check(message(Odometry, 'odom', 'arm'))
