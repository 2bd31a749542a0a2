# SPDX-License-Identifier: Apache-2.0
"""A robot with wheels, gyroscope and satellite receiver, from an unknown heading, and its faults.

Where the first heading is unknown, readings say later what it was, and nothing else is blamed.
"""

import sys

import numpy as np
import pytest
from tools.strangers.injected.array_replay import replay

from kalman_ros.analysis.diagnosis.beginning import likeliest
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.filter_pass import passage
from kalman_ros.analysis.records import InputRecord
from kalman_ros.core import Gaussian, Space

#: The robot of docs/how_to/own_robot.md.
ROBOT = {
    'model': 'robot_2d', 'filter': 'gaussian_sum', 'rate': 50.0,
    'model_parameters.turn_noise': 0.005,
    'sensors': ['wheels', 'gyroscope', 'gnss'],
    'wheels.rate': 25.0, 'gyroscope.rate': 25.0, 'gnss.rate': 5.0,
    'wheels.measures': ['vx', 'vy', 'wz'], 'wheels.noise': [0.05, 0.02, 0.1],
    'wheels.type': 'nav_msgs/Odometry', 'wheels.topic': 'odom',
    'wheels.fields': ['twist.twist.linear.x', 'twist.twist.linear.y', 'twist.twist.angular.z'],
    'gyroscope.measures': ['wz'], 'gyroscope.noise': [0.02],
    'gyroscope.type': 'sensor_msgs/Imu', 'gyroscope.topic': 'imu',
    'gyroscope.fields': ['angular_velocity.z'],
    'gnss.measures': ['x', 'y'], 'gnss.noise': [1.5, 1.5],
    'gnss.type': 'sensor_msgs/NavSatFix', 'gnss.topic': 'fix', 'gnss.fields': ['east', 'north'],
    'initial_estimate': [0.0] * 8, 'initial_std': [10.0, 10.0, 3.0, 1.0, 0.1, 0.5, 1.0, 1.0],
}  # fmt: skip
#: The same with a compass.
COMPASS = {
    **ROBOT, 'filter': 'ekf', 'sensors': [*ROBOT['sensors'], 'compass'],
    'compass.measures': ['yaw'], 'compass.noise': [0.05], 'compass.rate': 25.0,
    'compass.type': 'sensor_msgs/Imu', 'compass.topic': 'compass',
    'compass.fields': ['orientation.yaw'],
}  # fmt: skip
#: Steps between two readings, and the length of a step and of the recording in seconds.
EVERY, STEP, LENGTH = {'wheels': 2, 'gyroscope': 2, 'gnss': 10, 'compass': 2}, 0.02, 40.0


def drive(seed):
    """Return the first heading and readings of a robot that stands for 10 s, then drives."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, LENGTH, STEP)
    heading, moving = rng.uniform(-np.pi, np.pi), np.maximum(0.0, time - 10.0)
    speed, turn = np.minimum(1.5, 0.5 * moving), 0.15 * np.sin(0.3 * moving)
    yaw = heading + np.cumsum(turn) * STEP
    velocity = speed[:, None] * np.column_stack((np.cos(yaw), np.sin(yaw)))
    values = {
        'wheels': np.column_stack((speed, np.zeros_like(speed), turn)),
        'gyroscope': turn[:, None],
        'gnss': np.cumsum(velocity, axis=0) * STEP,
        'compass': np.angle(np.exp(1j * yaw))[:, None],
    }
    found = {}
    for name, value in values.items():
        y = value + rng.normal(size=value.shape) * COMPASS[f'{name}.noise']
        stamp = 1000.0 + time[:: EVERY[name]]
        found[name] = (stamp + 0.002, stamp, y[:: EVERY[name]], None)
    return heading, found


def evidence(readings, parameters=ROBOT):
    return replay(parameters, readings, InputRecord(np.zeros(0), np.zeros(0), np.zeros((0, 0))))


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('seed', [4, 5])
def test_the_pass_begins_with_the_heading_that_the_readings_tell(seed):
    heading, readings = drive(seed)
    first = passage(evidence(readings)).events[0]
    off = abs(np.angle(np.exp(1j * (first.x[2] - heading))))
    assert off < 3.0 * np.sqrt(first.P[2, 2]) < 1.8


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize(
    'seed',
    [pytest.param(4, marks=pytest.mark.xfail(strict=True, reason='3 s of wheels, 12 % sure')), 5],
)
def test_nothing_is_blamed_for_it(seed):
    causes = diagnose(evidence(drive(seed)[1])).findings
    # the simulated robot has no process noise: that may be said
    assert {cause.kind for cause in causes} <= {'process noise too large'}


@pytest.mark.thorough
@pytest.mark.slow
def test_outliers_are_found_beside_it(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], 'LENGTH', 25.0)
    _, readings = drive(11)
    received, stamp, fixes, none = readings['gnss']
    far = np.random.default_rng(3).random(len(fixes)) < 0.05
    readings['gnss'] = received, stamp, fixes + 60.0 * far[:, None], none
    cause = diagnose(evidence(readings)).findings[0]
    assert (cause.kind, cause.subject) == ('outliers', 'gnss')


def turned(v):
    cosine, sine = np.cos(0.35), np.sin(0.35)
    return np.column_stack(
        (cosine * v[:, 0] - sine * v[:, 1], sine * v[:, 0] + cosine * v[:, 1], v[:, 2])
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ('kind', 'wrong'),
    [
        pytest.param('unit', lambda v: v * [3.6, 3.6, 1.0], marks=pytest.mark.thorough),
        ('rotated', turned),
    ],
)
@pytest.mark.thorough
def test_speeds_may_be_wrong_beside_a_turn_rate_that_is_right(kind, wrong):
    _, readings = drive(11)
    received, stamp, wheels, none = readings['wheels']
    readings['wheels'] = received, stamp, wrong(wheels), none
    cause = diagnose(evidence(readings, COMPASS)).findings[0]
    assert (cause.kind, cause.subject) == (kind, 'wheels.vx,vy')
    M = np.reshape(cause.change['wheels.C'], (3, 8))[:, [3, 4, 5]]
    true = wrong(np.eye(3)).T
    np.testing.assert_allclose(M, true, atol=0.03)


SPACE = Space(('psi',), ('rad',), angles=('psi',))


def follow(target, failing=()):
    """Return what a filter makes of readings that tell an angle, and fails from other parts."""

    def followed(part):
        for count in range(1000):
            if count >= 10 and any(abs(part.mean[0] - each) < 0.1 for each in failing):
                raise np.linalg.LinAlgError('failed')
            yield float(SPACE.subtract(part.mean, np.array([target]))[0] ** 2)

    return followed


def test_a_part_is_chosen_of_a_wide_angle_and_of_no_other():
    wide, narrow = (Gaussian(np.zeros(1), np.array([[std**2]])) for std in (3.0, 0.3))
    found = likeliest(wide, SPACE, follow(2.0))
    assert abs(found.mean[0] - 2.0) < 0.4
    assert likeliest(narrow, SPACE, follow(2.0)) is narrow


def test_a_part_from_which_the_filter_fails_is_not_chosen():
    wide = Gaussian(np.zeros(1), np.array([[9.0]]))
    best = float(likeliest(wide, SPACE, follow(2.0)).mean[0])
    second = likeliest(wide, SPACE, follow(2.0, failing=[best])).mean
    assert 0.4 < abs(SPACE.subtract(second, np.array([2.0]))[0]) < 1.0


def test_if_all_filters_fail_it_is_the_belief_as_a_whole():
    wide = Gaussian(np.zeros(1), np.array([[9.0]]))
    assert likeliest(wide, SPACE, follow(2.0, failing=np.linspace(-4.0, 4.0, 100))) is wide
