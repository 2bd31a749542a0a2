# SPDX-License-Identifier: Apache-2.0
"""What the nodes of a loop ask of the graph, and what they wait for."""

import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry

from kalman_ros.codecs.messages import write_stamp
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.nodes.middleware import connections, meeting


@pytest.fixture
def clock(monkeypatch):
    time = [1000.0]
    monkeypatch.setattr(connections, 'monotonic', lambda: time[0])
    return time


def test_each_look_asks_about_one_topic_and_a_round_about_all(pair, monkeypatch, clock):
    """One question takes a good part of a millisecond, which a fast loop cannot spare twice."""
    node = pair(EstimatorNode).node
    asked, ask = [], node.get_publishers_info_by_topic
    monkeypatch.setattr(
        node, 'get_publishers_info_by_topic', lambda topic: asked.append(topic) or ask(topic)
    )
    found = node.diagnostics.connections
    round = []
    for _ in range(100):  # at one time: a new round begins only after a second
        del asked[:]
        found.look()
        assert len(asked) <= 1
        round += asked
    assert len(round) == len(set(round))
    assert {'/position', '/velocity', '/force', '/estimate'} <= set(round)


def test_what_lasts_is_reported_and_what_ends_is_not(pair, clock):
    started = pair(EstimatorNode)
    found = started.node.diagnostics.connections

    def look_at_all():
        for _ in range(40):
            clock[0] += 0.1
            found.look()

    look_at_all()
    look_at_all()
    assert '/position: no publishers' in found.problems
    started.publisher(PoseWithCovarianceStamped, 'position')
    look_at_all()
    assert '/position: no publishers' not in found.problems
    assert '/velocity: no publishers' in found.problems


def test_an_estimate_before_all_are_connected_is_answered_once_they_are(pair, monkeypatch):
    monkeypatch.setattr(meeting, '_LONGEST', 1e3)
    started = pair(ControllerNode)
    node, estimates = started.node, started.publisher(Odometry, 'estimate')
    message = Odometry()
    message.pose.pose.position.x = 1.0
    write_stamp(message.header.stamp, node.get_clock().now().nanoseconds)
    estimates.publish(message)
    started.until(lambda: node._early, 'no estimate was received')
    assert node._health.answered == 0
    forces = []
    for _ in range(2):
        started.peer.create_subscription(WrenchStamped, 'force', forces.append, 10)
    started.until(lambda: node._health.answered, 'the early estimate was not answered')
    assert not node._early
