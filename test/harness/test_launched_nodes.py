# SPDX-License-Identifier: Apache-2.0
"""Requests to nodes that are slow to answer."""

import pytest

pytest.importorskip('rclpy')

from rclpy.task import Future

from kalman_ros.harness.launched_nodes import LaunchedNodes


class Slow:
    """A service that takes its time for the first request, and the nodes around it."""

    call = LaunchedNodes.call

    def __init__(self, seconds):
        self._clients = {'plant/reset': self}
        self._now, self._free, self._seconds = 0.0, 0.0, seconds
        self.asked = []

    def service_is_ready(self):
        return True

    def wait(self, condition, *_):
        assert condition()

    def call_async(self, request):
        self._free = max(self._free, self._now) + (0.01 if self.asked else self._seconds)
        self.asked.append((self._free, Future()))
        return self.asked[-1][1]

    def spin(self, seconds, until):
        end = self._now + seconds
        for answered, future in self.asked:
            if answered <= end and not until.done() and not future.done():
                self._now = answered
                future.set_result(answered)
        if not until.done():
            self._now = end

    def open_requests(self):
        return [future for _, future in self.asked if not future.done()]


@pytest.mark.parametrize('seconds', [0.5, 1.5, 5.0])
def test_no_repeated_request_is_still_to_be_done_after_the_answer(seconds):
    slow = Slow(seconds)
    slow.call(None, 'plant/reset', None)
    assert slow.open_requests() == []
