# SPDX-License-Identifier: Apache-2.0
"""Configuration of RViz that shows the markers of a loop from above."""

from __future__ import annotations

from typing import Any

from kalman_ros.codecs.messages import message_type
from kalman_ros.scenario import Scenario

from .map_extent import extent

#: Width and height of the window in pixels, and number of lines of the grid.
_WIDTH, _HEIGHT, _LINES = 1200, 800, 20
_DEFAULT = 'rviz_default_plugins'


def rviz_file(scenario: Scenario, frame: str) -> dict[str, Any]:
    """Return the configuration, for YAML, of a scenario that the node ``markers`` draws."""
    across = extent(scenario)
    displays: list[dict[str, Any]] = [
        {
            'Class': f'{_DEFAULT}/Grid', 'Name': 'Grid', 'Enabled': True, 'Value': True,
            'Cell Size': across / _LINES, 'Plane Cell Count': _LINES,
            'Reference Frame': '<Fixed Frame>', 'Color': '120; 120; 120', 'Alpha': 0.5,
        },
        {
            'Class': f'{_DEFAULT}/MarkerArray', 'Name': 'Markers', 'Enabled': True, 'Value': True,
            'Namespaces': {}, 'Topic': _topic('/markers'),
        },
    ]  # fmt: skip
    if message_type(scenario.state.type) is message_type('nav_msgs/Odometry'):
        displays.append({
            'Class': f'{_DEFAULT}/Odometry', 'Name': 'Estimate', 'Enabled': False, 'Value': False,
            'Keep': 1, 'Topic': _topic(f'/{scenario.state.topic.lstrip("/")}'),
        })  # fmt: skip
    return {
        'Panels': [
            {'Class': 'rviz_common/Displays', 'Name': 'Displays'},
            {'Class': 'rviz_common/Time', 'Name': 'Time'},
        ],
        'Visualization Manager': {
            'Class': '',
            'Displays': displays,
            'Enabled': True,
            'Global Options': {
                'Background Color': '255; 255; 255', 'Fixed Frame': frame, 'Frame Rate': 30,
            },
            'Name': 'root',
            'Tools': [
                {'Class': f'{_DEFAULT}/MoveCamera'},
                {'Class': f'{_DEFAULT}/Measure'},
                {'Class': f'{_DEFAULT}/SetInitialPose', 'Topic': {'Value': '/initialpose'}},
            ],
            'Views': {
                'Current': {
                    'Class': f'{_DEFAULT}/TopDownOrtho', 'Name': 'Current View', 'Angle': 0.0,
                    'Scale': _HEIGHT / across, 'X': 0.0, 'Y': 0.0,
                    'Target Frame': '<Fixed Frame>',
                },
            },
        },
        'Window Geometry': {'Width': _WIDTH, 'Height': _HEIGHT},
    }  # fmt: skip


def _topic(name: str) -> dict[str, Any]:
    return {
        'Value': name, 'Depth': 5, 'History Policy': 'Keep Last',
        'Reliability Policy': 'Reliable', 'Durability Policy': 'Volatile',
    }  # fmt: skip
