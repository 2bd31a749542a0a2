# SPDX-License-Identifier: Apache-2.0
"""Requests to nodes that are slow to answer, or miss some."""

import pytest

pytest.importorskip('rclpy')

from rclpy.task import Future

from kalman_ros.harness.launched_nodes import LaunchedNodes, NodeError


class Service:
    """A client of a service, whose node answers in order."""

    def __init__(self, node, misses=0, seconds=0.0):
        self._node, self._misses, self._seconds = node, misses, seconds
        self.done = 0

    def call_async(self, request):
        future = Future()
        if self._misses:
            self._misses -= 1
        else:
            self._node.queue.append((self, future))
        return future

    def take(self):
        """Return the seconds that the next request takes."""
        seconds, self._seconds = self._seconds, 0.01
        self.done += 1
        return seconds


class Node:
    """A node with a service, and what the harness asks of it."""

    call, _responds = LaunchedNodes.call, LaunchedNodes._responds

    def __init__(self, **reset):
        self.queue, self.now, self._free = [], 0.0, 0.0
        self.reset, self._parameters = Service(self, **reset), Service(self)

    def _client(self, kind, service):
        return self.reset if service == 'plant/reset' else self._parameters

    def spin(self, seconds, until):
        end = self.now + seconds
        while self.queue and not until.done():
            service, future = self.queue[0]
            self._free = max(self._free, self.now) + service.take()
            if self._free > end:
                service.done -= 1
                service._seconds, self._free = self._free - end, end
                break
            del self.queue[0]
            self.now = self._free
            future.set_result(True)
        if not until.done():
            self.now = end


@pytest.mark.parametrize('seconds', [0.5, 1.5, 5.0, 25.0])
def test_a_slow_node_does_what_is_requested_once(seconds):
    node = Node(seconds=seconds)
    assert node.call(None, 'plant/reset', None)
    assert node.reset.done == 1
    assert node.now == pytest.approx(seconds, abs=0.1)
    node.spin(10.0, Future())
    assert node.reset.done == 1


@pytest.mark.parametrize('misses', [1, 3])
def test_a_request_that_was_lost_is_sent_again(misses):
    node = Node(misses=misses)
    assert node.call(None, 'plant/reset', None)
    assert node.reset.done == 1


def test_a_node_that_does_not_answer_is_an_error():
    with pytest.raises(NodeError, match='no answer from plant/reset within 30 s'):
        Node(seconds=1e3).call(None, 'plant/reset', None)
