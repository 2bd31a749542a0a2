# SPDX-License-Identifier: Apache-2.0
"""The count of messages that the middleware lost."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from kalman_ros.nodes.middleware import losses, private
from kalman_ros.nodes.middleware.watcher import WatcherNode


class Event(nullcontext):
    """An event of the middleware with a total count."""

    total = 0

    def take_event(self):
        """Return the status."""
        return SimpleNamespace(total_count=self.total)


@pytest.fixture
def event(monkeypatch):
    """Return the event that the next `Losses` reads."""
    event = Event()
    monkeypatch.setattr(private._rclpy, 'EventHandle', lambda handle, kind: event)
    return event


def counter():
    """Return a counter of the losses of a subscription."""
    return losses.Losses(SimpleNamespace(handle=nullcontext()))


# the last is what Fast DDS reported once after messages of 20 MB
@pytest.mark.parametrize('total', [2**31 - 1, 2**31, 18446744071562067969])
def test_a_total_that_overflowed_is_not_a_count_of_losses(event, total):
    losses = counter()
    event.total = 3
    assert losses.count == 3
    event.total = total
    assert losses.count == 3


def test_gaps_in_the_numbers_count_although_the_total_overflowed(event):
    losses = counter()
    event.total = 18446744071562067969
    for number in (1, 2, 7):
        losses.numbered(number)
    assert losses.count == 4


def received(*numbers):
    """Return how many messages are counted as lost among these, in the order of reception."""
    losses = counter()
    for number in numbers:
        losses.numbered(number)
    return losses.count


def test_a_second_writer_is_no_loss(event):
    assert received(5000, 20000, 5001, 20001, 5002) == 0
    assert received(1, 2, 853, 3, 854) == 0
    assert received(100, 50, 5000, 101, 51, 5001, 102, 52) == 0


def test_a_restarted_writer_is_no_loss(event):
    assert received(700, 701, 1, 2, 3) == 0


def test_losses_of_two_writers_add_up(event):
    assert received(5000, 20000, 5001, 20004, 5003, 20005) == 4


@pytest.mark.parametrize('seed', range(20))
def test_the_losses_of_interleaved_writers_are_no_more_than_were_lost(event, seed):
    rng = np.random.default_rng(seed)
    writers = [list(range(first, first + 200)) for first in rng.integers(1, 3000, 3)]
    kept = [[number for number in writer if rng.random() > 0.1] for writer in writers]
    lost = sum(200 - len(numbers) for numbers in kept)
    order = [numbers.pop(0) for numbers in _interleaved(rng, kept)]
    # messages lost before the first of a writer, and after its last, leave no gap
    assert 0.5 * lost < received(*order) <= lost


def _interleaved(rng, queues):
    """Yield the queues, each as often as it is long, in random order."""
    places = rng.permutation([i for i, queue in enumerate(queues) for _ in queue])
    for i in places:
        yield queues[i]


def test_a_loss_shows_with_the_next_message_also_if_it_comes_alone(pair):
    started = pair(lambda: WatcherNode('reader'))
    came = []
    # a queue of one message drops what it had, which the middleware does not count
    subscription = started.node.create_subscription(
        String, 'words', lambda message: came.append(message.data), QoSProfile(depth=1)
    )
    words = started.publisher(String, 'words')

    def publish(*texts):
        for text in texts:
            words.publish(String(data=text))
        started.until(lambda: came[-1:] == [texts[-1]], f'only {came}')

    publish('one')
    publish('two', 'three', 'four')
    publish('five')
    assert len(came) < 5
    assert len(came) + subscription.losses.count == 5
