# SPDX-License-Identifier: Apache-2.0
"""The count of messages that the middleware lost."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from kalman_ros.nodes import losses
from kalman_ros.nodes.watcher import WatcherNode


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
    monkeypatch.setattr(losses._rclpy, 'EventHandle', lambda handle, kind: event)
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
