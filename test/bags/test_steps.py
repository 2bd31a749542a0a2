# SPDX-License-Identifier: Apache-2.0
"""Parts of a recording of lockstep, by the time of its ticks."""

from itertools import chain

import pytest

pytest.importorskip('rclpy')

from kalman_ros.bags import blocks, budget, steps
from kalman_ros.bags.blocks import Message
from kalman_ros.bags.steps import Steps
from kalman_ros.codecs.tick import write_tick

SECOND = 1_000_000_000
BEGIN = 7 * SECOND


def messages():
    """Return five steps a second apart, each recorded within a millisecond."""
    found = []
    for step in range(5):
        time = 1_000_000 * step
        found.append(Message(time + 1, '/y', bytes([step])))
        found.append(Message(time + 2, '/tick', write_tick(BEGIN + step * SECOND, ('y',))))
        found.append(Message(time + 3, '/force', bytes([step])))
    return found


def test_the_part_is_that_of_simulated_time():
    part = Steps(messages(), '/tick', 1.5, 3.0)
    read = [message.data[0] for message in part if message.topic == '/y']
    assert read == [2, 3]
    assert part.origin == BEGIN


def test_without_limits_all_is_there_and_the_last_answer():
    assert list(Steps(messages(), '/tick')) == messages()


def test_a_step_has_the_input_before_it():
    topics = [message.topic for message in Steps(messages(), '/tick', 1.0, 1.0)]
    assert topics == ['/force', '/y', '/tick']


def test_a_tick_that_is_none_ends_nothing():
    broken = [Message(0, '/tick', b'\0\1'), *messages()]
    assert list(Steps(broken, '/tick')) == broken


def without_ticks(count, size=1):
    """Yield messages a millisecond apart, and say in ``read`` how many have been asked for."""
    for number in range(count):
        without_ticks.read = number + 1
        yield Message(SECOND + 1_000_000 * number, '/y', bytes(size))


def test_what_comes_without_a_tick_does_not_fill_the_memory():
    held = Steps(without_ticks(10 * budget.MOST_WAITING), '/tick', 1.0)
    with pytest.raises(ValueError, match='messages without a tick on /tick'):
        list(held)
    assert without_ticks.read < 2 * budget.MOST_WAITING + 2


def test_large_messages_without_a_tick_do_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr(steps, 'MOST_PENDING', 10_000)
    monkeypatch.setattr(blocks, 'MOST_PENDING', 10_000)
    with pytest.raises(ValueError, match='messages without a tick on /tick'):
        list(Steps(without_ticks(1000, size=1000), '/tick', 1.0))
    assert without_ticks.read < 30


@pytest.mark.slow
def test_a_whole_recording_needs_ticks_only_where_it_begins():
    rest = without_ticks(10 * budget.MOST_WAITING)
    passed = iter(Steps(chain(messages(), rest), '/tick'))
    assert [next(passed) for _ in messages()] == messages()
    assert sum(1 for _ in passed) == 10 * budget.MOST_WAITING


@pytest.mark.slow
def test_a_recording_without_ticks_does_not_fill_the_memory():
    with pytest.raises(ValueError, match='messages without a tick on /tick'):
        list(Steps(without_ticks(10 * budget.MOST_WAITING), '/tick'))
    assert without_ticks.read < 2 * budget.MOST_WAITING + 2


def test_the_order_of_publication_holds_no_more_than_fits(monkeypatch):
    monkeypatch.setattr(blocks, 'MOST_PENDING', 10_000)
    next(blocks.as_published(without_ticks(1000, size=1000)))
    assert without_ticks.read < 15
