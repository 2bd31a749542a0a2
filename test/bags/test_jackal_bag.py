# SPDX-License-Identifier: Apache-2.0
"""A real robot's recording by a file of robot_localization, translated, and nothing else."""

import numpy as np
import pytest
from recorded import data

pytest.importorskip('rclpy')
pytest.importorskip('rosbags')

from kalman_ros.bags.replay import replay
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


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_robot_ends_where_the_test_of_robot_localization_expects_it(tmp_path):
    # cra-ros-pkg/robot_localization, test_ekf_localization_node_bag3: within .1383 m
    (tmp_path / 'theirs.yaml').write_text(THEIRS)
    main([str(tmp_path / 'theirs.yaml'), '--out', str(tmp_path / 'ours.yaml')])
    found = replay(data('diff_drive_61s.bag'), tmp_path / 'ours.yaml')
    assert all(sensor.fused == len(sensor.nis) for sensor in found.sensors.values())
    distance = np.linalg.norm(found.beliefs.mean[-1, :3] - [1.0206, 3.4292, 0.7419])
    assert distance < 0.1383
    assert found.notes == ()  # all frames are those of the estimate
