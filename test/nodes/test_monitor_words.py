# SPDX-License-Identifier: Apache-2.0
"""What the monitor says of readings without a stamp."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.monitor.node import MonitorNode
from kalman_ros.scenario import build


@pytest.mark.parametrize(
    ('type', 'fields', 'words'),
    [
        ('std_msgs/Float64', ['data'], ': readings of position have no stamp'),
        ('sensor_msgs/Range', ['range'], ''),
    ],
)
def test_sensors_without_a_stamp_are_why_nothing_can_be_compared(type, fields, words):
    scenario = build({'model': 'linear', 'position.type': type, 'position.fields': fields})
    said = MonitorNode._unstamped(SimpleNamespace(scenario=scenario))
    assert said.startswith(words) and bool(said) is bool(words)
