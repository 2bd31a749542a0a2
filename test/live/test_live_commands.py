# SPDX-License-Identifier: Apache-2.0
"""Whatever a tab sends is answered, and no frame ends the loop."""

import json
import random
import string
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from kalman_ros.harness import NodeError
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.board import Board
from kalman_ros.live.controls import controls
from kalman_ros.live.live_commands import LiveCommands
from kalman_ros.live.pace import Pace
from kalman_ros.live.page_command import COMMANDS, read_command
from kalman_ros.live.streams import Streams
from kalman_ros.scenario import shipped


class Nodes:
    """Nodes that note what is asked of them."""

    def __init__(self, scenario):
        self.scenario, self.calls = scenario, []
        self.processes = dict.fromkeys(('plant', 'estimator', 'controller', 'monitor'))
        for name in ('set_parameters', 'reconfigure', 'push', 'trigger', 'run_until'):
            setattr(self, name, lambda *given, name=name: self.calls.append((name, *given)))


@pytest.fixture
def page():
    adjustments = Adjustments(shipped.file('mass_spring_damper'), {})
    scenario = adjustments.scenario('estimator')
    found = SimpleNamespace(nodes=Nodes(scenario), board=Board(), controls=controls(adjustments))
    found.commands = LiveCommands(
        found.nodes, Streams(scenario), adjustments, found.controls, Pace.usual(adjustments),
        found.board,
    )  # fmt: skip

    def send(text):
        command = read_command(text)
        if command is None:
            return None
        found.commands.carry_out(command, 0.0)
        return json.loads(found.board._frames[-1])['answer']

    found.send = send
    return found


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('{"do": "x", "n": 1}', 'unknown command "x"'),
        ('{"do": ["set"], "n": 1}', 'unknown command ["set"]'),
        ('{"n": 1}', 'unknown command null'),
        ('{"do": "push", "input": 0.5, "n": 1}', 'push: input cannot be 0.5'),
        ('{"do": "push", "input": true, "n": 1}', 'push: input cannot be true'),
        ('{"do": "push", "share": 11, "n": 1}', 'push: expected the number of an input'),
        ('{"do": "push", "share": 1' + '0' * 400 + ', "n": 1}', 'too large'),
        ('{"do": "reset", "shell": "ls", "n": 1}', 'reset: unknown field "shell"'),
        ('{"do": "mode", "n": 1}', 'mode: expected lockstep'),
        ('{"do": "speed", "value": 1' + '0' * 400 + ', "n": 1}', 'too large'),
        *(
            (f'{{"do": "poles", "poles": {poles}, "n": 1}}', 'poles: expected pairs')
            for poles in ('[[1, "2"]]', '[[1], [1, 2]]', '[]', '[[1e10, 0]]', '[[-1e999, 0]]')
        ),
        ('{"do": "push", "share": 1e999, "n": 1}', 'push: share cannot be null'),
        ('{"do": "set", "key": "plant/__class__", "value": 1, "n": 1}', 'unknown control'),
    ],
)
def test_a_wrong_command_is_answered_with_what_is_wrong(page, text, says):
    answer = page.send(text)
    assert answer['n'] == 1
    assert answer['error']
    assert says in answer['error']
    assert page.nodes.calls == []


@pytest.mark.parametrize(
    'text', ['1e999', 'NaN', '[]', '{', '[' * 4000, '', '"set"'],
)  # fmt: skip
def test_a_frame_that_is_no_json_object_is_dropped(text):
    assert read_command(text) is None
    assert read_command(text.encode()) is None


@pytest.mark.parametrize(
    'number', ['null', '"1"', '[1]', '{}', 'true', '1.5', '1e999', 'Infinity', '9' * 30]
)
def test_an_answer_repeats_no_number_that_is_not_an_integer(page, number):
    assert page.send(f'{{"do": "pause", "n": {number}}}')['n'] is None


def test_a_right_command_is_carried_out(page):
    key, control = next((k, c) for k, c in page.controls.items() if c.low is not None)
    low = control.low
    assert page.send(json.dumps({'do': 'set', 'key': key, 'value': low, 'n': 7})) == {
        'n': 7, 'error': '', 'ms': pytest.approx(0, abs=1e12),
    }  # fmt: skip
    assert {name for name, *_ in page.nodes.calls} == {'set_parameters'}


def test_a_number_that_ros_cannot_read_is_zero():
    command = read_command('{"do": "set", "key": "k", "value": 1e-310}')
    assert command.fields['value'] == 0.0
    assert read_command('{"do": "speed", "value": 2.3e-308}').fields['value'] == 2.3e-308


def test_the_death_of_a_node_is_not_an_answer(page):
    def dies(*_):
        raise NodeError('the plant has died')

    page.nodes.trigger = dies
    with pytest.raises(NodeError):
        page.send('{"do": "reset"}')


def test_ten_thousand_frames_are_answered_or_dropped(page):
    """Frames made of parts of right ones, values of all kinds, and noise."""
    chance = random.Random(1)
    names = [*COMMANDS, *{name for fields in COMMANDS.values() for name in fields}, 'n', 'do']
    keys = list(page.controls)

    def value(depth=0):
        if depth < 3 and chance.random() < 0.2:
            return [value(depth + 1) for _ in range(chance.randrange(4))]
        return chance.choice([
            None, True, False, 0, 1, -1, 2**63, -(10**300), 0.5, 1e308, 5e-324, '',
            '\x1b[2J', '\u202e',
            'kf', 'ekf', 'luenberger', 'lqr', 'placement', 'filter', 'law', 'estimator', {'a': 1},
            10 ** chance.randrange(400), chance.choice(keys), chance.choice(names),
        ])  # fmt: skip

    def frame():
        do = chance.choice([*COMMANDS, value()])
        fields = list(COMMANDS.get(do, ())) if isinstance(do, str) else []
        made = {name: value() for name in fields if chance.random() < 0.8}
        made |= {chance.choice(names): value() for _ in range(chance.randrange(2))}
        text = json.dumps({'do': do, 'n': value(), **made})
        if chance.random() < 0.2:
            at = chance.randrange(len(text))
            text = text[:at] + chance.choice(string.printable) + text[at + 1 :]
        return text.replace('0.5', '1e999') if chance.random() < 0.1 else text

    answers = [page.send(frame()) for _ in range(10_000)]
    answered = [answer for answer in answers if answer is not None]
    assert len(answered) > 7_000
    assert len([answer for answer in answered if not answer['error']]) > 1_000
