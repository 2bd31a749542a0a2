# SPDX-License-Identifier: Apache-2.0
"""A configuration of RViz names topics that exist, and shows where the loop starts."""

from functools import cache

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('visualization_msgs')

import yaml

from kalman_ros.live.map_extent import extent, is_drawn
from kalman_ros.live.rviz_file import rviz_file
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file


@cache
def scenario(name):
    return build(from_file(shipped.file(name), 'estimator'))


@pytest.mark.parametrize('name', shipped.names())
def test_the_topics_exist_and_the_start_is_in_the_picture(name):
    of = scenario(name)
    if not is_drawn(of):
        return
    found = yaml.safe_load(yaml.safe_dump(rviz_file(of, 'odom')))['Visualization Manager']
    topics = [each['Topic']['Value'] for each in found['Displays'] if 'Topic' in each]
    assert topics[0] == '/markers'
    assert {*topics[1:]} <= {f'/{of.state.topic}'}
    assert found['Global Options']['Fixed Frame'] == 'odom'
    pixels = found['Views']['Current']['Scale'] * extent(of)
    assert pixels == pytest.approx(800)
    x, y = (of.initial_state[of.model.state.names.index(axis)] for axis in 'xy')
    assert max(abs(x), abs(y)) < extent(of) / 2.0
