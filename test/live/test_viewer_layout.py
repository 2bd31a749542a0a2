# SPDX-License-Identifier: Apache-2.0
"""Layouts name topics and fields that exist, for every scenario."""

import json
import re
from functools import cache

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.core import Signal
from kalman_ros.live.viewer_layout import layout, message_paths
from kalman_ros.pipeline.estimate_topics import published_signals
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file

NAMES = shipped.names()
#: Topics of every node.
NODES = {'/diagnostics', '/rosout', '/markers'}


@cache
def of(name):
    return build(from_file(shipped.file(name), 'estimator'))


def signals(scenario):
    """Return the signals of the running nodes by the full names of their topics."""
    found = [*published_signals(scenario), Signal('ground_truth', *typed(scenario.state))]
    found += [source.signal for source in scenario.enabled.values()]
    if scenario.input.fields:
        found.append(scenario.input)
    return {f'/{signal.topic}': signal for signal in found}


def typed(signal):
    return signal.type, signal.fields


def resolve(message, path):
    """Return what a viewer reads at a path such as ``.pose.position.x`` or ``.data[3].@sqrt``."""
    path = re.sub(r'\.@(sqrt|negative)$', '', path)
    for name, index in re.findall(r'\.(\w+)|\[(\d+)\]', path):
        message = getattr(message, name) if name else message[int(index)]
    return float(message)


def named(found):
    """Return the identifiers of panels in a tree."""
    if isinstance(found, str):
        return [found]
    return [*named(found['first']), *named(found['second'])]


@pytest.mark.parametrize('name', NAMES)
def test_every_series_is_a_number_of_a_message_of_the_loop(name):
    scenario = of(name)
    known = signals(scenario)
    paths = [
        series['value']
        for panel in layout(scenario, 'map', ordered=True)['configById'].values()
        for series in panel.get('paths', ())
    ]
    assert len(paths) >= 2 * scenario.model.state.size
    topics = {path.partition('.')[0] for path in paths}
    read = [each.signal for each in scenario.enabled.values() if any(message_paths(each.signal))]
    assert {f'/{signal.topic}' for signal in read} <= topics
    for path in paths:
        topic = re.match(r'[\w/]+', path).group()
        signal = known[topic]
        codec = codec_of(signal)
        size = len(signal.fields)
        message = codec.encode(0, np.zeros(size))
        resolve(message, path.removeprefix(topic))


@pytest.mark.parametrize('name', NAMES)
def test_a_path_has_the_value_of_its_field(name):
    scenario = of(name)
    for topic, signal in signals(scenario).items():
        values = 0.1 + 0.01 * np.arange(len(signal.fields))
        if signal.type == 'sensor_msgs/NavSatFix':
            assert message_paths(signal) == [None] * len(values)
            continue
        message = codec_of(signal).encode(0, values)
        for path, value in zip(message_paths(signal), values):
            if path is not None:
                assert resolve(message, path.removeprefix(topic)) == pytest.approx(value)


def test_every_panel_is_in_the_tree_once_and_the_other_way_round():
    scenario = of('robot_2d')
    found = json.loads(json.dumps(layout(scenario, 'map')))
    panels = found['configById']
    tabs = [tab for panel in panels.values() for tab in panel.get('tabs', ())]
    shown = [*named(found['layout']), *(each for tab in tabs for each in named(tab['layout']))]
    assert sorted(shown) == sorted(panels)
    assert {each.partition('!')[0] for each in shown} == {
        '3D', 'Plot', 'Parameters', 'Tab', 'DiagnosticSummary', 'RosOut'
    }  # fmt: skip
    for panel in panels.values():
        topics = {*panel.get('topics', ()), panel.get('topicToRender', '/rosout')}
        assert topics <= NODES


def titles_of_plots(found):
    return [p['title'] for n, p in found['configById'].items() if n.startswith('Plot')]


def test_plots_are_named_by_what_they_show():
    assert titles_of_plots(layout(of('cart_pole'), 'map', ordered=True)) == [
        'x [m]', 'v [m/s]', 'theta [rad]', 'omega [rad/s]', 'innovation of joint_states', 'NIS',
        'standard deviations of x [m]', 'standard deviations of v [m/s]',
        'standard deviations of theta [rad]', 'standard deviations of omega [rad/s]',
        'readings of joint_states', 'input',
    ]  # fmt: skip
    for name in NAMES:
        titles = titles_of_plots(layout(of(name), 'map'))
        assert len({*titles}) == len(titles)
        assert max(map(len, titles)) < 60


def test_joints_of_a_robot_may_have_another_order_so_that_their_readings_have_no_path():
    known, unknown = (
        json.dumps(layout(of('cart_pole'), 'map', ordered=ordered)) for ordered in (True, False)
    )
    assert '"/joint_states.position[0]"' in known
    assert '"/joint_states' not in unknown


def test_a_model_without_input_and_without_a_map_has_no_panel_for_them():
    scenario = of('nile')
    panels = layout(scenario, 'map')['configById']
    titles = [tab['title'] for panel in panels.values() for tab in panel.get('tabs', ())]
    assert 'Input' not in titles
    assert not any(name.startswith('3D') for name in panels)


def test_an_angle_of_a_quaternion_has_no_path():
    fields = ('pose.pose.position.x', 'pose.pose.orientation.yaw')
    signal = Signal('a/b', 'nav_msgs/Odometry', fields)
    assert message_paths(signal) == ['/a/b.pose.pose.position.x', None]
