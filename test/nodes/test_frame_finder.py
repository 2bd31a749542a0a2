# SPDX-License-Identifier: Apache-2.0
"""A search for a transform, without a middleware: it ends, and where it is denied it says why."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from rclpy._rclpy_pybind11 import RCLError
from static_frames import message

from kalman_ros.codecs.messages import UndecodableError
from kalman_ros.nodes.estimator import frame_finder
from kalman_ros.nodes.estimator.frame_finder import FrameFinder

PLACED = message(('map', 'odom', (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)))


class Node:
    """What a search uses of a node."""

    steady = None

    def __init__(self, denied=()):
        self.alive, self.denied, self.dropped = [], denied, 0

    def create_subscription(self, kind, topic, callback, queue, raw):
        if topic in self.denied:
            raise RCLError(f'failed to create subscription: {topic} is not allowed, at ./x.c:1')
        return self._created(callback)

    def create_timer(self, seconds, callback, clock):
        return self._created(callback)

    def _created(self, callback):
        self.alive.append(SimpleNamespace(callback=callback))
        return self.alive[-1]

    def destroy_subscription(self, entity):
        self.alive.remove(entity)

    destroy_timer = destroy_subscription

    @property
    def intake(self):
        """The node itself: it takes in what comes."""
        return self

    def read(self, topic, read, data):
        try:
            read(data)
        except UndecodableError:
            self.dropped += 1


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    monkeypatch.setattr(frame_finder, 'message_type', lambda _: object)


def test_a_search_ends_once_what_it_is_for_is_done():
    node, known = Node(), []
    finder = FrameFinder(node)

    def then(frames):
        known.append(frames.placement('odom', 'map'))
        return known[-1] is not None

    assert finder.find(then, pytest.fail) == ''
    static, dynamic, _ = node.alive
    static.callback(b'no message')
    static.callback(message(('odom', 'base_link', (0.0,) * 6 + (1.0,))))
    assert (node.dropped, known, len(node.alive)) == (1, [None, None], 3)
    dynamic.callback(PLACED)
    assert known[-1].translation.tolist() == [1.0, 2.0, 3.0]
    assert not node.alive
    dynamic.callback(PLACED)  # queued in an executor
    assert len(known) == 3


def test_a_search_in_vain_ends_with_a_refusal():
    node, refused = Node(), []
    assert FrameFinder(node).find(lambda _: False, lambda: refused.append(True)) == ''
    timer = node.alive[-1]
    timer.callback()
    timer.callback()
    assert refused == [True] and not node.alive


def test_a_new_search_is_in_the_place_of_an_earlier_one():
    node, finder = Node(), None
    finder = FrameFinder(node)
    finder.find(pytest.fail, pytest.fail)
    old = [*node.alive]
    taken = []
    finder.find(lambda _: not taken.append(True), pytest.fail)
    for each in old:
        each.callback(PLACED)
    assert not taken and len(node.alive) == 3
    node.alive[1].callback(PLACED)
    assert taken == [True] and not node.alive


@pytest.mark.parametrize('topic', ['/tf', '/tf_static'])
def test_where_transforms_are_not_allowed_the_reason_is_returned(topic):
    node = Node(denied=(topic,))
    why = FrameFinder(node).find(pytest.fail, pytest.fail)
    assert why == f'failed to create subscription: {topic} is not allowed'
    assert not node.alive
