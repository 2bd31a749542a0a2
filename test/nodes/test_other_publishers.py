# SPDX-License-Identifier: Apache-2.0
"""Which other publishers of a topic are named, without a middleware."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.middleware import connections
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


def test_endpoints_are_counted_once_a_second(monkeypatch):
    counted, now = [], [100.0]
    endpoint = SimpleNamespace(topic_name='/velocity')
    node = SimpleNamespace(
        subscriptions=[endpoint],
        watched=[],
        publishers=[],
        count_publishers=lambda topic: counted.append(topic) or 1,
        count_subscribers=lambda topic: 1,
        get_publishers_info_by_topic=lambda topic: [],
        get_subscriptions_info_by_topic=lambda topic: [],
        get_fully_qualified_name=lambda: '/estimator',
    )
    monkeypatch.setattr(connections, 'monotonic', lambda: now[0])
    found = Connections(node)
    for look in range(31):  # ten a second
        now[0] = 100.0 + 0.1 * look + 1e-6
        found.look()
    assert 3 <= len(counted) <= 4
