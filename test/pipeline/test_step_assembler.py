# SPDX-License-Identifier: Apache-2.0
"""Lockstep waits for all of a step, whatever the order of arrival."""

import random
from time import process_time

import pytest

pytest.importorskip('rclpy')

from kalman_ros.codecs.messages import UndecodableError
from kalman_ros.codecs.tick import read_tick, write_tick
from kalman_ros.pipeline.step_assembler import StepAssembler


def steps(count=6):
    """Yield what a run sends: both sensors at even steps, one at odd ones."""
    for time in range(1, count + 1):
        topics = ['position', 'velocity'] if time % 2 == 0 else ['velocity']
        for topic in topics:
            yield 'reading', time, topic
        yield 'tick', time, topics
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
    return StepAssembler({'position': 'position', 'velocity': 'velocity'})


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
    assert len(send(turns, 'tick', 1, [])) == 1
    assert send(turns, 'tick', 2, []) == []
    assert [turn.time for turn in send(turns, 'input', 1, None)] == [2]


def test_a_repeated_tick_is_answered_without_readings():
    turns = fresh()
    send(turns, 'reading', 1, 'velocity')
    send(turns, 'tick', 1, ['velocity'])
    send(turns, 'reading', 1, 'velocity')
    (again,) = send(turns, 'tick', 1, ['velocity'])
    assert again[:3] == (1, None, [])


def test_topics_that_nobody_listens_to_are_not_waited_for():
    assert len(send(fresh(), 'tick', 1, ['elsewhere'])) == 1


def test_time_that_goes_back_is_a_reset():
    turns = fresh()
    for message in steps(3):
        send(turns, *message)
    turns.reading('velocity', 1, 'new')
    assert turns.tick(1, ['velocity'])
    (turn,) = turns.complete()
    assert turn[:3] == (1, None, [('velocity', 'new')])


def test_of_a_model_without_inputs_no_answer_is_waited_for():
    turns = StepAssembler({'position': 'position', 'velocity': 'velocity'}, answered=False)
    messages = [message for message in steps() if message[0] != 'input']
    taken = [turn for message in messages for turn in send(turns, *message)]
    assert [turn.time for turn in taken] == [1, 2, 3, 4, 5, 6]
    assert all(turn.input is None for turn in taken)


def test_what_has_no_stamp_belongs_to_the_turn_that_waits_for_it():
    turns = fresh()
    for time in (1, 2, 3):
        turns.tick(time, ['velocity'])
        turns.reading('velocity', None, f'y@{time}')
        (turn,) = turns.complete()
        assert turn.readings == [('velocity', f'y@{time}')]
        assert turn.input == (None if time == 1 else (time - 1, f'u@{time - 1}'))
        turns.input(None, f'u@{time}')


def test_a_late_reading_is_taken_at_the_tick_that_names_it():
    turns = fresh()
    assert send(turns, 'reading', 1, 'position') == []
    (first,) = send(turns, 'tick', 1, [])
    assert first.readings == []
    turns.input(1, 'u@1')
    assert send(turns, 'tick', 2, ['position@1', 'velocity']) == []
    (second,) = send(turns, 'reading', 2, 'velocity')
    assert second.readings == [('position', 'position@1'), ('velocity', 'velocity@2')]
    turns.input(2, 'u@2')
    assert send(turns, 'tick', 3, ['position@1']) == []  # it is taken once


def test_a_topic_named_twice_has_two_readings():
    turns = fresh()
    turns.reading('position', 1, 'one')
    assert send(turns, 'tick', 1, ['position', 'velocity', 'position']) == []
    turns.reading('velocity', 1, 'v')
    assert list(turns.complete()) == []
    turns.reading('position', 1, 'two')
    (turn,) = turns.complete()
    assert turn.readings == [('position', 'one'), ('velocity', 'v'), ('position', 'two')]


def test_what_was_taken_and_comes_again_is_not_left_for_a_plant_that_is_restarted():
    turns = fresh()
    turns.reading('velocity', 1, 'first')
    assert len(send(turns, 'tick', 1, ['velocity'])) == 1
    assert [turn.readings for turn in send(turns, 'tick', 1, ['velocity'])] == [[]]
    turns.reading('velocity', 1, 'again')
    turns.input(1, 'u@1')
    turns.reading('position', 2, 'second')
    assert len(send(turns, 'tick', 2, ['position'])) == 1
    assert turns.tick(1, ['velocity'])
    assert list(turns.complete()) == []
    turns.reading('velocity', 1, 'new')
    (turn,) = turns.complete()
    assert turn.readings == [('velocity', 'new')]


@pytest.mark.parametrize('seed', range(30))
def test_late_readings_whatever_the_order_of_arrival(seed):
    """Every reading of position comes two steps late, each third of them twice."""
    messages = []
    for time in range(1, 9):
        topics = [f'position@{time - 2}'] * (2 if time % 3 == 0 else 1) if time > 2 else []
        messages += [('reading', time - 2, 'position')] * len(topics)
        messages += [('reading', time, 'velocity'), ('tick', time, [*topics, 'velocity'])]
        messages += [('input', time, None)]
    rng = random.Random(seed)
    queues = {}
    for message in messages:
        queues.setdefault(message[0] if message[0] != 'reading' else message[2], []).append(
            message
        )
    mixed = []
    while any(queues.values()):
        mixed.append(queues[rng.choice([key for key in sorted(queues) if queues[key]])].pop(0))
    assert run(mixed) == run(messages)
    assert [len(turn.readings) for turn in run(mixed)] == [1, 1, 3, 2, 2, 3, 2, 2]


@pytest.mark.parametrize('text', ['position@', 'position@x', 'position@1@2', '@', 'position@-1',
                                  'position@' + '9' * 5000])  # fmt: skip
def test_what_names_no_reading_is_not_waited_for(text):
    assert [turn.readings for turn in send(fresh(), 'tick', 1, [text])] == [[]]


def test_a_tick_that_names_what_never_comes_is_given_up_when_its_topic_goes_on():
    turns = fresh()
    send(turns, 'tick', 1, [])
    turns.input(1, 'u@1')
    assert send(turns, 'tick', 2, ['velocity']) == []  # no plant sent it
    assert send(turns, 'tick', 3, ['position', 'velocity']) == []
    assert send(turns, 'reading', 3, 'position') == []  # position tells nothing of velocity
    (turn,) = send(turns, 'reading', 3, 'velocity')
    assert (turn.time, turn.input) == (3, (1, 'u@1'))
    assert [name for name, _ in turn.readings] == ['position', 'velocity']


@pytest.mark.slow
def test_ticks_of_a_future_that_never_comes_are_bounded():
    turns = fresh()
    for time in range(10, 30_000):
        turns.tick(time, ['velocity'])
    assert len(turns._ticks) < 15_000
    turns.reading('velocity', 1, 'y')
    turns.tick(1, ['velocity'])
    assert next(turns.complete()).time == 1


def test_only_an_input_that_was_lost_is_asked_for_again():
    turns = fresh()
    send(turns, 'tick', 1, [])
    assert turns.unanswered is None
    send(turns, 'tick', 2, ['velocity'])
    assert turns.unanswered is None  # the reading is still to come
    send(turns, 'reading', 2, 'velocity')
    assert turns.unanswered == 1
    assert turns.waits_for(2)
    assert len(send(turns, 'input', 1, None)) == 1
    assert turns.unanswered is None
    assert not turns.waits_for(2)


def test_a_tick_that_names_what_never_comes_is_given_up_when_the_plant_asks_again():
    turns = fresh()
    send(turns, 'tick', 1, [])
    turns.input(1, 'u@1')
    assert send(turns, 'tick', 2, ['position']) == []  # no plant sent it
    assert send(turns, 'tick', 3, []) == []
    assert [turn.time for turn in send(turns, 'tick', 3, [])] == [3]


@pytest.mark.slow
def test_what_a_hostile_sender_makes_wait_is_bounded():
    turns = fresh()
    for time in range(1, 30_000):
        turns.reading('velocity', 10**15 + time, 'y')
        turns.reading('position', 5, 'again and again')
        turns.input(10**15 + time, 'u')
        turns.tick(10**15 + time, ['position'], kept='x' * 100)
    assert sum(map(len, turns._readings.values())) <= 10_000
    assert len(turns._inputs) <= 10_000
    assert len(turns._ticks) <= 1000
    assert len(turns._kept) <= 1000


def test_ticks_that_name_much_take_time_in_proportion():
    began = process_time()
    turns = fresh()
    for time in range(1, 300):
        turns.tick(time, ['velocity', *('position',) * 900])
        turns.reading('position', time + 1, 'y')
        turns.reading('velocity', time, 'y')
        assert list(turns.complete()) == []
    assert process_time() - began < 5.0


def test_a_turn_brings_back_what_was_kept_with_its_tick():
    turns = fresh()
    turns.tick(1, ['velocity'], kept='first')
    turns.tick(1, ['velocity'], kept='asked again')
    turns.reading('velocity', 1, 'y')
    (turn,) = turns.complete()
    assert turn.kept == 'asked again'


@pytest.mark.parametrize('topics', [('position',) * 1001, ('x' * 70_000,)])
def test_a_tick_longer_than_that_of_any_plant_is_none(topics):
    with pytest.raises(UndecodableError, match='no tick'):
        read_tick(write_tick(1, topics))


def test_a_relative_and_an_absolute_name_are_of_one_topic():
    def full(topic):
        if '{' in topic:
            raise ValueError('no name of a topic')
        if topic.startswith('0'):  # as rclpy does
            raise RuntimeError('failed to resolve name')
        return topic if topic.startswith('/') else f'/robot/{topic}'

    for ours, theirs in (('/robot/y', 'y'), ('y', '/robot/y'), ('y', 'y')):
        turns = StepAssembler({ours: 'sensor'}, answered=False, resolve=full)
        turns.reading('sensor', 1, 'reading')
        turns.tick(1, ['/other', '{', '0', theirs])
        assert [step.readings for step in turns.complete()] == [[('sensor', 'reading')]]
