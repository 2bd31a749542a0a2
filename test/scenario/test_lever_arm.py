# SPDX-License-Identifier: Apache-2.0
"""A sensor off the centre of the body reads what a rigid body says, and is consistent."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kalman_ros import scenario
from kalman_ros.core import Sensor, Signal, Space, numerical_jacobian
from kalman_ros.estimators import build_filter
from kalman_ros.scenario import shipped
from kalman_ros.scenario.body_roles import body_of
from kalman_ros.scenario.lever_arm import LeverArm
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.simulation.simulated_plant import SimulatedPlant

NAMES = ['x', 'y', 'z', 'roll', 'pitch', 'yaw', 'vx', 'vy', 'vz', 'wx', 'wy', 'wz']
SPACE = Space(tuple(NAMES), angles=('roll', 'pitch', 'yaw'))
FIELDS = (
    *(f'pose.pose.position.{axis}' for axis in 'xyz'),
    *(f'pose.pose.orientation.{angle}' for angle in ('roll', 'pitch', 'yaw')),
    *(f'twist.twist.linear.{axis}' for axis in 'xyz'),
    *(f'twist.twist.angular.{axis}' for axis in 'xyz'),
)
BODY = body_of(SPACE, Signal('estimate', 'nav_msgs/Odometry', FIELDS))
ARM = [-0.6, 0.3, 1.4]


class Zero(Sensor):
    """Reads nothing, so that what is read is what the lever arm adds."""

    def __init__(self, size):
        self.output = Space(tuple(f'y{index}' for index in range(size)))
        self.covariance = np.eye(size)

    def measure(self, x):
        return np.zeros((*x.shape[:-1], self.output.size))


def added(fields, x):
    sensor = LeverArm(Zero(len(fields)), BODY, fields, ARM)
    np.testing.assert_allclose(
        sensor.jacobian(x), numerical_jacobian(sensor.measure, x), atol=1e-8
    )
    both = sensor.measure(np.stack((x, x)))
    np.testing.assert_array_equal(both[0], sensor.measure(x))
    return sensor.measure(x)


@pytest.fixture
def x():
    return np.random.default_rng(3).normal(size=12)


def test_a_position_is_moved_by_the_turned_arm(x):
    turned = Rotation.from_euler('xyz', x[3:6]).apply(ARM)
    np.testing.assert_allclose(added(('east', 'north', 'up'), x), turned)
    np.testing.assert_allclose(added(('pose.pose.position.y',), x), turned[1:2])


def test_a_velocity_is_that_of_a_rigid_body(x):
    rate = x[9:]
    fields = ('twist.twist.linear.z', 'twist.twist.linear.x', 'twist.twist.angular.x')
    swung = np.cross(rate, ARM)
    np.testing.assert_allclose(added(fields, x), [swung[2], swung[0], 0.0])


def test_an_acceleration_points_to_the_axis(x):
    rate = x[9:]
    fields = tuple(f'linear_acceleration.{axis}' for axis in 'xyz')
    np.testing.assert_allclose(added(fields, x), np.cross(rate, np.cross(rate, ARM)))


def test_a_rotation_vector_turns_the_arm_as_its_angles_do(x):
    space = Space('x y z rx ry rz wx wy wz', rotations=(('rx', 'ry', 'rz'),))
    fields = tuple(f'position[{name}]' for name in space.names)
    body = body_of(space, Signal('estimate', 'sensor_msgs/JointState', fields))
    other = np.concatenate((x[:3], Rotation.from_euler('xyz', x[3:6]).as_rotvec(), x[9:]))
    kinds = ('east', 'north', 'up'), tuple(f'linear_acceleration.{axis}' for axis in 'xyz')
    for read in kinds:
        gravity = 9.8 if read is kinds[1] else 0.0
        by_angles = LeverArm(Zero(3), BODY, read, ARM, gravity)
        by_vector = LeverArm(Zero(3), body, read, ARM, gravity)
        by_vector.state = space
        np.testing.assert_allclose(by_vector.measure(other), by_angles.measure(x))
        turned = space.add(other, np.array([0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 0.0, 0.0]))
        change = (by_vector.measure(turned) - by_vector.measure(other)) / 1e-6
        np.testing.assert_allclose(by_vector.jacobian(other)[:, 3], change, atol=1e-4)


def test_gravity_is_along_the_axis_of_the_world_that_is_up(x):
    fields = tuple(f'linear_acceleration.{axis}' for axis in 'xyz')
    level = LeverArm(Zero(3), BODY, fields, [0.0] * 3, 9.8)
    up = Rotation.from_euler('xyz', x[3:6]).inv().apply([0.0, 0.0, 9.8])
    np.testing.assert_allclose(level.measure(x), up)
    np.testing.assert_allclose(level.jacobian(x), numerical_jacobian(level.measure, x), atol=1e-8)
    both = LeverArm(Zero(3), BODY, fields, ARM, 9.8)
    np.testing.assert_allclose(both.measure(x), up + added(fields, x))


def test_the_velocity_of_a_place_is_the_rate_of_its_position(x):
    """The two formulas agree, by differences."""
    dt, rotation = 1e-6, Rotation.from_euler('xyz', x[3:6])
    later = x.copy()
    later[3:6] = (rotation * Rotation.from_rotvec(x[9:] * dt)).as_euler('xyz')
    fields = ('east', 'north', 'up')
    speed = (added(fields, later) - added(fields, x)) / dt
    swung = added(tuple(f'linear.{axis}' for axis in 'xyz'), x)
    np.testing.assert_allclose(speed, rotation.apply(swung), atol=1e-5)


def values(**changes):
    return {**from_file(shipped.file('navsat'), 'estimator'), **changes}


def test_a_body_goes_by_the_names_of_its_states():
    built = scenario.build(values(), with_law=False)
    sensor = built.sensors['gnss'].sensor
    x = np.array([10.0, 20.0, np.pi / 2, 1.0, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(sensor.measure(x), [10.0 - 0.3, 20.0 - 0.6])
    assert sensor.name == 'gnss'


@pytest.mark.parametrize(
    ('changes', 'why'),
    [
        ({'gnss.mount.translation': [1.0, 2.0]}, 'gnss.mount.translation: expected forward'),
        (
            {'gnss.mount.translation': [1.0, 2.0, float('nan')]},
            'expected -10000 to 10000 m, got nan',
        ),
        ({'gnss.mount.gravity': 9.8}, 'gnss.mount.gravity: expected an acceleration among'),
        (
            {'gnss.fields': ['latitude', 'longitude']},
            'gnss.fields: expected east, north or up, in m, for x, got latitude, in degrees',
        ),
        ({'gnss.mount.rotation': [0.0, 0.0, 90.0]}, 'expected -6.28319 to 6.28319 rad, got 90'),
        (
            {'model': 'constant_velocity', 'sensors': ['gnss'], 'initial_state': [0.0] * 4},
            'takes a state with a heading',
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(changes, why):
    given = values(**changes)
    if 'model' in changes:
        given = {key: value for key, value in given.items() if not key.startswith(_OTHER)}
    with pytest.raises(ValueError, match=f'gnss.mount.translation: .*{why}|{why}'):
        scenario.build(given, with_law=False)


_OTHER = ('model_parameters', 'initial_', 'state.', 'imu.')


@pytest.mark.thorough
@pytest.mark.slow
def test_without_the_arm_the_filter_is_wrong_and_with_it_consistent():
    """20 s of an antenna 3 m behind the centre, judged by the NIS of the receiver."""
    truth = values(**{'gnss.noise': [0.1, 0.1], 'gnss.mount.translation': [-3.0, 1.0, 1.4]})
    with_it = _simulated(truth, truth)
    without = _simulated(truth, {**truth, 'gnss.mount.translation': [0.0, 0.0, 0.0]})
    assert with_it == pytest.approx(1.0, abs=0.35)  # 3.5 sigma of 101 readings of two numbers
    assert without > 3.0


def _simulated(real, believed):
    """Return the mean NIS of the receiver, over its degrees of freedom."""
    real, believed = (scenario.build(each, with_law=False) for each in (real, believed))
    plant = SimulatedPlant(real.model, real.timed, real.rate, real.initial_state, 1)
    ekf = build_filter('ekf', believed.plan, {}, 'native')
    belief, nis = believed.initial_belief, []
    for _ in range(2000):
        for name, y in plant.readings().items():
            found = ekf.correct(belief, y, believed.sensors[name].sensor)
            belief = found.posterior
            if name == 'gnss':
                nis.append(found.nis / 2)
        plant.step(np.zeros(0))
        belief = ekf.predict(belief, np.zeros(0), 0.01)
    return np.mean(nis)
