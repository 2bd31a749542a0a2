# SPDX-License-Identifier: Apache-2.0
"""A real robot's recording by a file of robot_localization, translated, and nothing else."""

import numpy as np
import pytest
from recorded import data

pytest.importorskip('rclpy')
pytest.importorskip('rosbags')

from kalman_ros.analysis.tuning.fit import fit
from kalman_ros.analysis.tuning.held_out import judge
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.replay import replay
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Signal
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.programs.from_robot_localization.program import main
from kalman_ros.programs.tune.recorded_likelihood import load

THEIRS = """\
ekf_se_node:
  ros__parameters:
    frequency: 50.0
    odom0: /jackal_velocity_controller/odom
    odom0_config: [false, false, false, false, false, false, true, true, true,
                   false, false, false, false, false, false]
    imu0: /imu/data
    imu0_config: [false, false, false, true, true, true, false, false, false,
                  true, true, true, true, true, true]
    imu0_remove_gravitational_acceleration: true
    world_frame: odom
    publish_tf: false
    process_noise_covariance: [0.03, 0.03, 0.4, 0.03, 0.03, 0.06, 0.025, 0.025, 0.05,
                               0.002, 0.002, 0.004, 0.01, 0.01, 0.01]
"""


ODOMETRY, IMU = '/jackal_velocity_controller/odom', '/imu/data'
#: What of that is a reading of its own, the orientation and the speed of the wheels, with the
#: process noise that `tune` fits.
SPARE = f"""\
ekf_se_node:
  ros__parameters:
    odom0: {ODOMETRY}
    odom0_config: [false, false, false, false, false, false, true, false, false,
                   false, false, false, false, false, false]
    imu0: {IMU}
    imu0_config: [false, false, false, true, true, true, false, false, false,
                  false, false, false, false, false, false]
    world_frame: odom
    publish_tf: false
    process_noise_covariance: [0.03, 0.03, 0.4, 0.0, 0.0, 0.0, 0.0223, 0.0, 0.0,
                               0.053, 0.1254, 0.168, 39.4, 0.01, 0.01]
"""

#: The last place in that test, and how near it must be.
PLACE, ALLOWED = np.array([1.0206, 3.4292, 0.7419]), 0.1383


def translated(tmp_path, text, *, plane=False):
    """Return our file for theirs, in space or in the plane."""
    theirs, ours = tmp_path / 'theirs.yaml', tmp_path / 'ours.yaml'
    mode = 'two_d_mode: true\n    ' if plane else ''
    theirs.write_text(text.replace('world_frame', f'{mode}world_frame'))
    main([str(theirs), '--out', str(ours)])
    return ours


def replayed(file, changes=None):
    """Return what a file makes of the recording."""
    found = replay(data('diff_drive_61s.bag'), file, changes)
    assert all(sensor.fused == len(sensor.nis) for sensor in found.sensors.values())
    assert found.notes == ()  # all frames are those of the estimate
    return found


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_robot_ends_where_the_test_of_robot_localization_expects_it(tmp_path):
    # cra-ros-pkg/robot_localization, test_ekf_localization_node_bag3: within .1383 m
    found = replayed(translated(tmp_path, THEIRS))
    assert np.linalg.norm(found.beliefs.mean[-1, :3] - PLACE) < ALLOWED


def recorded(topic, kind, *fields):
    """Return the stamps (N,) in s and the values (N, k) of a topic."""
    read = WireReader(SignalCodec(Signal(topic, kind, fields)))
    bag = Bag(data('diff_drive_61s.bag'))
    rows = [read(message.data)[:2] for message in bag.messages([topic])]
    return 1e-9 * np.array([time - rows[0][0] for time, _ in rows]), np.array([y for _, y in rows])


def dead_reckoning(*, slope):
    """Return where velocity of the wheels and yaw of the IMU lead (2,), in the plane.

    On a ``slope``, as the pitch of the IMU has it, or as if the ground were level.
    """
    time, v = recorded(ODOMETRY, 'nav_msgs/Odometry', 'twist.twist.linear.x')
    at, angles = recorded(IMU, 'sensor_msgs/Imu', 'orientation.yaw', 'orientation.pitch')
    yaw, pitch = (np.interp(time, at, angle) for angle in np.unwrap(angles, axis=0).T)
    passed = v[:, 0] * (np.cos(pitch) if slope else 1.0) * np.append(np.diff(time), 0.0)
    return np.array([passed @ np.cos(yaw), passed @ np.sin(yaw)])


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.thorough
def test_in_the_plane_it_ends_where_its_readings_lead_without_the_slope(tmp_path):
    """The wheels measure the way along the ground; in a plane there is no slope to project it."""
    level = dead_reckoning(slope=False)
    assert np.linalg.norm(level - PLACE[:2]) > ALLOWED
    assert np.linalg.norm(dead_reckoning(slope=True) - PLACE[:2]) < ALLOWED
    found = replayed(translated(tmp_path, THEIRS, plane=True))
    # the filter adds no error to that
    assert np.linalg.norm(found.beliefs.mean[-1, :2] - level) < 0.01


@pytest.mark.slow
def test_its_readings_are_fewer_than_its_numbers():
    """The orientation is the integral of the rates, and two velocities are always zero."""
    _, v = recorded(ODOMETRY, 'nav_msgs/Odometry', *(f'twist.twist.linear.{a}' for a in 'xyz'))
    assert not v[:, 1:].any()
    time, y = recorded(
        IMU, 'sensor_msgs/Imu', *(f'orientation.{angle}' for angle in ('roll', 'pitch', 'yaw')),
        'angular_velocity.y', 'angular_velocity.z',
    )  # fmt: skip
    roll, pitch, yaw, wy, wz = y.T
    turned = np.diff(np.unwrap(yaw))
    rate = (wy * np.sin(roll) + wz * np.cos(roll)) / np.cos(pitch)
    # the step from a message to the next is the rate of the next, to 2 % of its size
    assert np.std(turned - rate[1:] * np.diff(time)) < 0.02 * np.std(turned)


def own_noise(turning, still):
    """Return the noise of the sensors, too small to show, and no slip along some axes."""
    return {
        'sensors': ['imu0_orientation', 'odom0_velocity', 'no_slip'],
        'imu0_orientation.noise': [1e-5] * turning, 'odom0_velocity.noise': [1e-4],
        'imu0_orientation.covariance_from': 'configuration',
        'odom0_velocity.covariance_from': 'configuration',
        'no_slip.zero': True, 'no_slip.measures': [f'v{axis}' for axis in still],
        'no_slip.noise': [0.01] * len(still), 'no_slip.topic': ODOMETRY,
        'no_slip.type': 'nav_msgs/Odometry',
        'no_slip.fields': [f'twist.twist.linear.{axis}' for axis in still],
    }  # fmt: skip


def roughness(topic, kind, field):
    """Return the squared second differences of a field, the last 30 % over the rest."""
    _, y = recorded(topic, kind, field)
    squares = np.diff(np.unwrap(y[:, 0]), 2) ** 2
    return _last_over_rest(squares)


def _last_over_rest(squares):
    rest, last = np.split(squares, [round(0.7 * len(squares))])
    return last.mean() / rest.mean()


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_tuned_in_the_plane_the_nis_is_that_of_a_consistent_filter(tmp_path):
    """Over the recording that was fitted; its end is rougher, by no fault of the filter."""
    file = translated(tmp_path, SPARE, plane=True)
    noises = ['turn_noise', 'velocity_noise.0', 'acceleration_noise.0']
    start = {**own_noise(1, 'y'), 'model_parameters.turn_noise': 0.05}
    bag = data('diff_drive_61s.bag')
    loaded = load(bag, file, start, noises, {}, {}, 0.0)
    assert not any('no_slip' in name for name in loaded.named.usual)
    likelihood = loaded.likelihood
    found = fit(likelihood)
    assert found.converged
    assert found.values['model_parameters.turn_noise'] == pytest.approx(0.168, rel=0.02)
    (whole,) = judge(likelihood, found.values, None)
    assert [*whole.sensors] == ['imu0_orientation', 'odom0_velocity']
    for each in whole.sensors.values():
        low, high = each.nis_bounds
        assert low < each.nis < high
        assert abs(each.whiteness) < 0.2
    # constant noise of any size is too small for the end, if it is right for the beginning
    measured = {
        'imu0_orientation': roughness(IMU, 'sensor_msgs/Imu', 'orientation.yaw'),
        'odom0_velocity': roughness(ODOMETRY, 'nav_msgs/Odometry', 'twist.twist.linear.x'),
    }
    for name, ratio in measured.items():
        assert ratio > 1.5
        assert _last_over_rest(whole.sensors[name].squares) == pytest.approx(ratio, rel=0.1)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_tuned_in_space_it_ends_there_with_the_nis_of_a_consistent_filter(tmp_path):
    """With the noise that `tune` fits in a minute and a half, which is too long for a test."""
    file = translated(tmp_path, SPARE)
    found = replayed(file, own_noise(3, 'yz'))
    assert np.linalg.norm(found.beliefs.mean[-1, :3] - PLACE) < ALLOWED
    for name, degrees in (('imu0_orientation', 3), ('odom0_velocity', 1)):
        nis = found.sensors[name].nis / degrees
        low, high = chi_square_bounds(1.0, 2.0 / (degrees * len(nis)), 1e-3)
        assert low < nis.mean() < high
