# SPDX-License-Identifier: Apache-2.0
"""The estimator in place of robot_localization's ekf_node, with Nav2's lifecycle manager."""

from pathlib import Path

from launch import LaunchDescription
from launch_ros.actions import Node

PARAMETERS = str(Path(__file__).with_name('wheels_and_imu.yaml'))


def generate_launch_description():
    """Return the estimator and its manager."""
    return LaunchDescription(
        [
            Node(
                package='kalman_ros',
                executable='estimator',
                parameters=[PARAMETERS],
                remappings=[('estimate/odometry', 'odometry/filtered')],
            ),
            Node(
                package='nav2_lifecycle_manager',
                executable='lifecycle_manager',
                name='lifecycle_manager_localization',
                parameters=[{'autostart': True, 'node_names': ['estimator']}],
            ),
        ]
    )
