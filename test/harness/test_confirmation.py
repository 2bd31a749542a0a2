# SPDX-License-Identifier: Apache-2.0
"""The recorder confirms steps of which it has all messages that are published."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from kalman_ros import scenario
from kalman_ros.codecs.tick import read_tick, write_tick
from kalman_ros.harness.confirmation import Confirmation

SECOND = 1_000_000_000


class Node:
    """Has publishers of some topics; hands over ticks, and keeps what is confirmed."""

    def __init__(self, published):
        self._published, self.confirmed = published, []

    def resolve_topic_name(self, topic):
        return f'/{topic}'

    def count_publishers(self, topic):
        return int(topic in self._published)

    def create_publisher(self, kind, topic, queue):
        return SimpleNamespace(publish=lambda data: self.confirmed.append(read_tick(data)[0]))

    def watch(self, kind, topic, callback, queue):
        self.tick = callback
        return SimpleNamespace(topic_name=f'/{topic}')

    def create_timer(self, period, callback, clock):
        self.look = callback


@pytest.mark.parametrize(
    ('published', 'received', 'confirmed'),
    [
        # the step that all have come up to
        (('ground_truth', 'estimate', 'force'), {'ground_truth': 9, 'estimate': 8, 'force': 7}, 7),
        # of what is published the first messages are waited for
        (('ground_truth', 'estimate', 'force'), {'ground_truth': 9, 'estimate': 8}, 3),
        (('ground_truth', 'estimate', 'force'), {}, 3),
        # what nobody publishes is not
        (('ground_truth', 'estimate'), {'ground_truth': 9, 'estimate': 8}, 8),
        (('ground_truth',), {'ground_truth': 9}, 9),
    ],
)
def test_a_step_is_confirmed_once_all_that_is_published_of_it_has_come(
    published, received, confirmed
):
    node = Node(published)
    raw = {topic: [] for topic in ('ground_truth', 'estimate', 'force')}
    for topic, second in received.items():
        raw[topic] += [write_tick(3 * SECOND, ()), write_tick(second * SECOND, ())]
    built = scenario.build({'model': 'mass_spring_damper'})
    Confirmation(node, built, SimpleNamespace(raw=raw, received={}))
    node.look()
    assert node.confirmed == []  # before the first step
    node.tick(write_tick(3 * SECOND, ()))
    for _ in range(20):
        node.look()
    assert node.confirmed[-1] == confirmed * SECOND


def test_steps_wait_for_readings_only_while_many_are_missing():
    node, counts = Node(('ground_truth',)), {'/position': 0}
    raw = {'ground_truth': [write_tick(9 * SECOND, ())], 'estimate': [], 'force': []}
    built = scenario.build({'model': 'mass_spring_damper'})
    Confirmation(node, built, SimpleNamespace(raw=raw, received=counts))
    for step in range(501):
        node.tick(write_tick(SECOND + step, ('position', 'another')))
    node.look()
    assert node.confirmed == []
    counts['/position'] = 1
    node.look()
    assert node.confirmed == [9 * SECOND]
