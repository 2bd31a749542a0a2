# SPDX-License-Identifier: Apache-2.0
"""Bearings of landmarks from an instrument that is turned against its body."""

import numpy as np
import pytest
from tools.strangers.injected.array_replay import replay

from kalman_ros.analysis.diagnosis import contradicted_parameters
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.records import InputRecord
from kalman_ros.core import Space
from kalman_ros.sensors.landmarks import Landmarks

STATE = Space(('x', 'y', 'yaw'), ('m', 'm', 'rad'), angles=('yaw',))
POSITIONS = [5.0, 0.0, 0.0, 8.0, -6.0, -2.0]


def test_all_bearings_are_too_large_by_the_offset():
    x = np.array([[0.3, -0.2, 0.5], [1.0, 2.0, -3.0]])
    plain, turned = (
        Landmarks(STATE, [0.1, 0.01], positions=POSITIONS, bearing_offset=offset).measure(x)
        for offset in (0.0, 0.04)
    )
    np.testing.assert_allclose(turned - plain, [[0.0, 0.04] * 3] * 2, atol=1e-15)


def test_the_diagnosis_fits_it():
    """A robot that is pushed about among three marks, whose camera looks aside."""
    rng, steps, dt = np.random.default_rng(3), 400, 0.1
    t = dt * np.arange(steps)
    path = np.column_stack([np.sin(0.3 * t), np.cos(0.2 * t), 0.4 * np.sin(0.5 * t)])
    sensor = Landmarks(STATE, [0.05, 0.01], positions=POSITIONS)
    marks = sensor.measure(path) + rng.normal(0.0, [0.05, 0.01] * 3, (steps, 6))
    marks[:, 1::2] += 0.04
    pose = path + rng.normal(0.0, [0.05, 0.05, 0.01], path.shape)
    robot = {
        'model': 'robot_2d', 'filter': 'ekf', 'rate': 10.0, 'sensors': ['marks', 'pose'],
        'marks.kind': 'landmarks', 'marks.positions': POSITIONS, 'marks.noise': [0.05, 0.01],
        'marks.measures': ['x', 'y', 'yaw'], 'marks.type': 'sensor_msgs/JointState',
        'marks.fields': [f'position[{k}{i}]' for i in range(3) for k in ('range', 'bearing')],
        'pose.measures': ['x', 'y', 'yaw'], 'pose.noise': [0.05, 0.05, 0.01],
        'pose.type': 'geometry_msgs/PoseStamped',
        'pose.fields': ['pose.position.x', 'pose.position.y', 'pose.orientation.yaw'],
        'initial_estimate': [0.0, 1.0, 0.0, 0.3, 0.0, 0.2, 0.0, 0.0],
    }  # fmt: skip
    taken = {
        name: (1000.0 + t, 1000.0 + t, value, None)
        for name, value in {'marks': marks, 'pose': pose}.items()
    }
    nothing = InputRecord(np.zeros(0), np.zeros(0), np.zeros((0, 0)))
    case = Examination(replay(robot, taken, nothing))
    best = max(contradicted_parameters.find(case), key=lambda finding: finding.gain)
    assert best.subject == 'marks.bearing_offset'
    assert best.change['marks.bearing_offset'] == pytest.approx(0.04, abs=0.005)
