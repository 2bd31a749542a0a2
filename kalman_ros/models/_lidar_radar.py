# SPDX-License-Identifier: Apache-2.0
"""A lidar and a radar, as the models that are tracked by them have them."""

from __future__ import annotations

from collections.abc import Sequence

from kalman_ros.core import SensorSetup, Signal


def lidar_and_radar(measures: Sequence[str]) -> dict[str, SensorSetup]:
    """Return both; ``measures`` are the states that the radar's reading depends on."""
    return {
        'lidar': SensorSetup(
            kind='states',
            options={'measures': ['x', 'y']},
            noise=(0.15, 0.15),
            rate=10.0,
            signal=Signal(
                'lidar',
                'geometry_msgs/PoseWithCovarianceStamped',
                ('pose.pose.position.x', 'pose.pose.position.y'),
            ),
        ),
        'radar': SensorSetup(
            kind='radar',
            options={'measures': list(measures)},
            noise=(0.3, 0.03, 0.3),
            rate=7.0,
            signal=Signal(
                'radar',
                'sensor_msgs/JointState',
                ('position[range]', 'position[bearing]', 'position[range_rate]'),
            ),
        ),
    }
