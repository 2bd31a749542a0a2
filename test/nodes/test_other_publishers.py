# SPDX-License-Identifier: Apache-2.0
"""Which other publishers of a topic are named, without a middleware."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.middleware.connections import Connections


def said(topic, *publishers):
    """Return what the node /estimator finds where nodes with these names publish a topic."""
    endpoints = [
        SimpleNamespace(node_namespace='/', node_name=name, topic_type='x', qos_profile=None)
        for name in publishers
    ]
    node = SimpleNamespace(
        get_fully_qualified_name=lambda: '/estimator',
        get_publishers_info_by_topic=lambda _: endpoints,
        get_subscriptions_info_by_topic=lambda _: [],
    )
    return [*Connections(node)._of_publisher(topic)]


def test_another_publisher_is_named():
    assert said('/estimate', 'estimator') == []
    assert said('/estimate', 'estimator', 'other') == ['/estimate: /other publishes here, too']


def test_a_second_node_of_the_same_name_is_named():
    (line,) = said('/estimate', 'estimator', 'estimator')
    assert line == 'there is a second node with the name /estimator'


@pytest.mark.parametrize('topic', ['/tf', '/tf_static', '/bond', '/r1/tf', '/r1/bond'])
def test_what_all_share_is_left_alone(topic):
    assert said(topic, 'estimator', 'estimator', 'manager') == []
