# SPDX-License-Identifier: Apache-2.0
"""Sensors of states with a rotation or a heading."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kalman_ros import sensors
from kalman_ros.core import Gaussian, TimedSensor, numerical_jacobian
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.plan import Plan
from kalman_ros.models.inertial import Inertial
from kalman_ros.models.robot_2d import Robot2D
from kalman_ros.models.robot_3d import Robot3D

SPACE, PLANE, NAVIGATION = Robot3D.state, Robot2D.state, Inertial.state
STATES = {15: np.random.default_rng(0).normal(size=(4, 15)), 8: np.ones((1, 8))}
ANCHORS = [0.0, 0.0, 3.0, 5.0, 1.0, 0.0, -4.0, 2.0, 1.0]
TURN = ['rx', 'ry', 'rz']
CASES = {
    'yaw': ('euler', SPACE, [0.1], {}),
    'angles': ('euler', SPACE, [0.1] * 3, {'angles': ['pitch', 'roll', 'yaw']}),
    'imu': ('imu', SPACE, [0.1] * 6, {}),
    'accelerometer': ('imu', SPACE, [0.1] * 3, {'measures': [*TURN, 'ax', 'ay', 'az']}),
    'magnetometer': ('magnetometer', SPACE, [1e-6] * 3, {'field': [0.1, 0.8, -1.3]}),
    'wheels': ('body_velocity', NAVIGATION, [0.1] * 2, {'axes': ['z', 'x']}),
    'cone': (
        'landmarks', SPACE, [0.1, 0.2, 0.3],
        {
            'measures': ['x', 'y', 'z', *TURN], 'positions': ANCHORS,
            'reads': ['range', 'bearing', 'elevation'],
        },
    ),
    'anchors': (
        'landmarks', SPACE, [0.1],
        {'measures': ['x', 'y', 'z'], 'positions': ANCHORS, 'reads': ['range']},
    ),
    'plane': ('landmarks', PLANE, [0.1, 0.2], {'positions': [3.0, 4.0, -2.0, 9.0]}),
}  # fmt: skip


def build(name):
    kind, state, noise, options = CASES[name]
    return sensors.build(kind, state, noise, options)


@pytest.mark.parametrize('name', CASES)
def test_jacobians_are_those_on_the_group_and_many_are_as_one(name):
    found = build(name)
    xs = STATES[found.state.size]
    expected = [
        numerical_jacobian(found.measure, x, found.output.subtract, found.state) for x in xs
    ]
    np.testing.assert_allclose([found.jacobian(x) for x in xs], expected, atol=1e-7)
    together = np.broadcast_to(found.jacobian(xs), np.shape(expected))
    np.testing.assert_allclose(together, expected, atol=1e-7)
    np.testing.assert_allclose(found.measure(xs), [found.measure(x) for x in xs], atol=1e-12)
    assert found.measure(xs).shape == (len(xs), found.output.size)
    assert found.covariance.shape == (found.output.size,) * 2


def turned(x, v):
    return Rotation.from_rotvec(x[3:6]).inv().apply(v)


def test_they_read_what_scipy_turns():
    x = STATES[15][1]
    np.testing.assert_allclose(
        build('angles').measure(x)[[1, 0, 2]], Rotation.from_rotvec(x[3:6]).as_euler('xyz')
    )
    force = x[12:] + turned(x, [0.0, 0.0, 9.80665])
    np.testing.assert_allclose(build('imu').measure(x), [*x[9:12], *force])
    np.testing.assert_allclose(build('accelerometer').measure(x), force)
    np.testing.assert_allclose(build('magnetometer').measure(x), turned(x, [0.1, 0.8, -1.3]))
    np.testing.assert_allclose(build('wheels').measure(x), turned(x, x[6:9])[[2, 0]])


def test_an_imu_at_rest_reads_gravity_upwards_and_one_without_gravity_nothing():
    np.testing.assert_array_equal(build('imu').measure(np.zeros(15))[3:], [0.0, 0.0, 9.80665])
    free = sensors.build('imu', SPACE, [0.1] * 6, {'gravity': 0.0})
    np.testing.assert_array_equal(free.measure(np.zeros(15)), np.zeros(6))


def test_landmarks_are_seen_from_the_robot():
    x = STATES[15][2]
    expected = []
    for landmark in np.reshape(ANCHORS, (3, 3)):
        a, b, c = turned(x, landmark - x[:3])
        distance = np.sqrt(a * a + b * b + c * c)
        expected += [distance, np.arctan2(b, a), np.arcsin(c / distance)]
    found = build('cone')
    np.testing.assert_allclose(found.measure(x), expected)
    assert found.output.names[:4] == ('range_1', 'bearing_1', 'elevation_1', 'range_2')
    assert found.output.angles == tuple(n for n in found.output.names if n[0] in 'be')
    np.testing.assert_allclose(build('anchors').measure(x), expected[::3])
    heading = build('plane').measure(np.array([1.0, 2.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(heading[:2], [np.sqrt(8.0), -np.pi / 4])


def test_a_landmark_at_the_robot_is_finite():
    found, x = build('plane'), np.zeros(8)
    x[:2] = 3.0, 4.0
    assert np.isfinite(found.measure(x)).all()


@pytest.mark.parametrize(
    ('kind', 'state', 'count', 'options', 'says'),
    [
        ('euler', PLANE, 1, {}, r'measures: expected the names of a rotation, none, got'),
        ('euler', SPACE, 1, {'angles': ['jaw']}, "angles: expected names among"),
        ('imu', SPACE, 2, {'measures': [*TURN, 'ax', 'ay']}, 'and 3 accelerations, got'),
        ('imu', SPACE, 6, {'measures': ['x', 'y', 'z']}, 'expected the names of a rotation'),
        ('magnetometer', SPACE, 3, {'field': [0.0] * 3}, 'field: expected a field other than'),
        ('body_velocity', SPACE, 3, {'measures': [*TURN, 'vx']}, 'expected 6 names, got 4'),
        ('landmarks', PLANE, 2, {'positions': [1.0]}, 'positions: expected 2 finite numbers'),
        ('landmarks', PLANE, 2, {'positions': [np.inf, 1.0]}, 'positions: expected 2 finite'),
        ('landmarks', PLANE, 2, {'measures': ['x', 'yaw']}, 'expected 2 or 3 names of the pos'),
        ('landmarks', PLANE, 2, {'measures': ['x', 'y']}, 'a direction takes a heading'),
        ('landmarks', PLANE, 1, {'reads': ['elevation']}, 'elevation takes a position in space'),
        ('landmarks', PLANE, 3, {}, 'noise: expected 2 numbers'),
    ],
)  # fmt: skip
def test_a_wrong_option_is_named(kind, state, count, options, says):
    with pytest.raises(ValueError, match=says):
        sensors.build(kind, state, [0.1] * count, options)


def test_landmarks_locate_a_robot_from_a_wrong_heading():
    sensor = build('plane')
    sensor.name = 'landmarks'
    filter = build_filter('ekf', Plan(Robot2D(), {'landmarks': TimedSensor(sensor, 10.0)}, 10.0))
    truth = np.array([0.5, -0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    belief = Gaussian(np.zeros(8), np.diag([1.0, 1.0, 0.5, *[1e-4] * 5]))
    for _ in range(20):
        belief = filter.predict(belief, np.zeros(0), 0.1)
        belief = filter.correct(belief, sensor.measure(truth), sensor).posterior
    np.testing.assert_allclose(belief.mean[:3], truth[:3], atol=0.05)
    assert (belief.std[:3] < 0.1).all()
