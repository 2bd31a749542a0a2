# SPDX-License-Identifier: Apache-2.0
"""Nodes in this process, with a peer, in a private domain."""

import sys
import time

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.task import Future

from kalman_ros.harness.domain import Domain


class Pair:
    """A node that is tested, and another one in the same process."""

    def __init__(self, build):
        self.node, self.peer = build(), rclpy.create_node('peer')
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)

    def publisher(self, kind, topic):
        """Return a publisher of the peer that the node has found."""
        found = self.peer.create_publisher(kind, topic, 1000)
        self.until(found.get_subscription_count, f'no subscriber of {topic}')
        return found

    def until(self, condition, complaint):
        """Let the node work until a condition holds, for some seconds at most."""
        end = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < end, complaint
            self._executor.spin_until_future_complete(Future(), 0.01)

    def spin_peer(self):
        """Let the peer take what has come, such as the answer of a service."""
        rclpy.spin_once(self.peer, timeout_sec=0.0)

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        self.peer.destroy_node()


@pytest.fixture
def pair(monkeypatch):
    """Return a function that starts a node with parameters, beside a peer."""
    domain, pairs = Domain(), []

    def started(build, file='', **parameters):
        settings = [word for item in parameters.items() for word in ('-p', '{}:={}'.format(*item))]
        args = ['--ros-args', *(['--params-file', file] if file else []), *settings]
        monkeypatch.setattr(sys, 'argv', ['test', *args])
        rclpy.init(args=args, domain_id=domain.id)
        pairs.append(Pair(build))
        return pairs[0]

    yield started
    for each in pairs:
        each.close()
    rclpy.try_shutdown()
    domain.close()
