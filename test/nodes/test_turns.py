# SPDX-License-Identifier: Apache-2.0
"""Lockstep waits for all of a step, whatever the order of arrival."""

import random

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.turns import Turns


def steps(count=6):
    """Yield what a run sends: both sensors at even steps, one at odd ones."""
    for time in range(1, count + 1):
        topics = ['position', 'velocity'] if time % 2 == 0 else ['velocity']
        for topic in topics:
            yield 'reading', time, topic
        yield 'tick', time, ','.join(topics)
        yield 'input', time, None


def send(turns, kind, time, value):
    if kind == 'reading':
        turns.reading(value, time, f'{value}@{time}')
    elif kind == 'tick':
        turns.tick(time, value)
    else:
        turns.input(time, f'u@{time}')
    return list(turns.complete())


def fresh():
    return Turns({'position': 'position', 'velocity': 'velocity'})


def run(messages):
    turns = fresh()
    return [turn for message in messages for turn in send(turns, *message)]


def test_in_order():
    taken = run(steps())
    assert [turn.time for turn in taken] == [1, 2, 3, 4, 5, 6]
    assert taken[0].input is None
    assert taken[1].input == (1, 'u@1')
    assert [name for name, _ in taken[1].readings] == ['position', 'velocity']


@pytest.mark.parametrize('seed', range(30))
def test_each_topic_in_order_but_topics_in_any(seed):
    rng = random.Random(seed)
    queues = {}
    for message in steps():
        key = message[0] if message[0] != 'reading' else message[2]
        queues.setdefault(key, []).append(message)
    mixed = []
    while queues:
        key = rng.choice(sorted(queues))
        mixed.append(queues[key].pop(0))
        if not queues[key]:
            del queues[key]
    assert run(mixed) == run(steps())


def test_a_turn_waits_for_the_input_before_it():
    turns = fresh()
    assert len(send(turns, 'tick', 1, '')) == 1
    assert send(turns, 'tick', 2, '') == []
    assert [turn.time for turn in send(turns, 'input', 1, None)] == [2]


def test_a_repeated_tick_is_answered_without_readings():
    turns = fresh()
    send(turns, 'reading', 1, 'velocity')
    send(turns, 'tick', 1, 'velocity')
    send(turns, 'reading', 1, 'velocity')
    (again,) = send(turns, 'tick', 1, 'velocity')
    assert again == (1, None, [])


def test_topics_that_nobody_listens_to_are_not_waited_for():
    assert len(send(fresh(), 'tick', 1, 'elsewhere')) == 1


def test_time_that_goes_back_starts_anew():
    turns = fresh()
    for message in steps(3):
        send(turns, *message)
    turns.reading('velocity', 1, 'new')
    assert turns.tick(1, 'velocity')
    (turn,) = turns.complete()
    assert turn == (1, None, [('velocity', 'new')])
