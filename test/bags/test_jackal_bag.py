# SPDX-License-Identifier: Apache-2.0
"""A real robot's recording by a file of robot_localization, translated, and nothing else."""

import numpy as np
import pytest
from recorded import data

pytest.importorskip('rclpy')
pytest.importorskip('rosbags')

from kalman_ros.bags.reading import Bag
from kalman_ros.bags.replay import replay
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Signal
from kalman_ros.programs.from_robot_localization.program import main

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


#: The last place in that test, and how near it must be.
PLACE, ALLOWED = np.array([1.0206, 3.4292, 0.7419]), 0.1383


def replayed(tmp_path, text):
    """Return what the translated file makes of the recording."""
    (tmp_path / 'theirs.yaml').write_text(text)
    main([str(tmp_path / 'theirs.yaml'), '--out', str(tmp_path / 'ours.yaml')])
    found = replay(data('diff_drive_61s.bag'), tmp_path / 'ours.yaml')
    assert all(sensor.fused == len(sensor.nis) for sensor in found.sensors.values())
    assert found.notes == ()  # all frames are those of the estimate
    return found


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_robot_ends_where_the_test_of_robot_localization_expects_it(tmp_path):
    # cra-ros-pkg/robot_localization, test_ekf_localization_node_bag3: within .1383 m
    found = replayed(tmp_path, THEIRS)
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
    time, v = recorded('/jackal_velocity_controller/odom', 'nav_msgs/Odometry',
                       'twist.twist.linear.x')  # fmt: skip
    at, angles = recorded('/imu/data', 'sensor_msgs/Imu', 'orientation.yaw', 'orientation.pitch')
    yaw, pitch = (np.interp(time, at, angle) for angle in np.unwrap(angles, axis=0).T)
    passed = v[:, 0] * (np.cos(pitch) if slope else 1.0) * np.append(np.diff(time), 0.0)
    return np.array([passed @ np.cos(yaw), passed @ np.sin(yaw)])


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_in_the_plane_it_ends_where_its_readings_lead_without_the_slope(tmp_path):
    """The wheels measure the way along the ground; in a plane there is no slope to project it."""
    level = dead_reckoning(slope=False)
    assert np.linalg.norm(level - PLACE[:2]) > ALLOWED
    assert np.linalg.norm(dead_reckoning(slope=True) - PLACE[:2]) < ALLOWED
    found = replayed(tmp_path, THEIRS.replace('world_frame', 'two_d_mode: true\n    world_frame'))
    # the filter adds no error to that
    assert np.linalg.norm(found.beliefs.mean[-1, :2] - level) < 0.01
