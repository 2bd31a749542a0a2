# SPDX-License-Identifier: Apache-2.0
"""Two estimators in place of two ekf_nodes and navsat_transform, with Nav2's lifecycle manager."""

from pathlib import Path

from launch import LaunchDescription
from launch_ros.actions import Node

PARAMETERS = str(Path(__file__).with_name('gnss.yaml'))


def estimator(name, odometry):
    """Return an estimator whose pose and twist are on the topic ``odometry``."""
    scope = name.removesuffix('_estimator')
    return Node(
        package='kalman_ros',
        executable='estimator',
        name=name,
        parameters=[PARAMETERS],
        remappings=[(f'{scope}/estimate/odometry', odometry)],
    )


def generate_launch_description():
    """Return the estimators and their manager."""
    return LaunchDescription(
        [
            estimator('local_estimator', 'odometry/local'),
            estimator('global_estimator', 'odometry/global'),
            Node(
                package='nav2_lifecycle_manager',
                executable='lifecycle_manager',
                name='lifecycle_manager_localization',
                parameters=[
                    {'autostart': True, 'node_names': ['local_estimator', 'global_estimator']}
                ],
            ),
        ]
    )
