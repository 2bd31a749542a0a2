# SPDX-License-Identifier: Apache-2.0
"""Whatever a tab sends is answered, and no frame ends the loop."""

import json
import random
import string
from collections import defaultdict
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.harness import NodeError
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.board import Board
from kalman_ros.live.controls import controls
from kalman_ros.live.limits import limits
from kalman_ros.live.live_commands import LiveCommands
from kalman_ros.live.live_nodes import FOREVER
from kalman_ros.live.pace import Pace
from kalman_ros.live.page_command import COMMANDS, read_command
from kalman_ros.live.scene import places
from kalman_ros.live.streams import Streams
from kalman_ros.scenario import shipped


class Nodes:
    """Nodes that note what is asked of them."""

    def __init__(self, scenario):
        self.scenario, self.calls = scenario, []
        self.processes = dict.fromkeys(('plant', 'estimator', 'controller', 'monitor'))
        self.reports = {}
        for name in ('set_parameters', 'reconfigure', 'push', 'trigger', 'run_until', 'follow'):
            setattr(self, name, lambda *given, name=name: self.calls.append((name, *given)))

    def take(self):
        return defaultdict(list)

    def reported(self, node, key):
        return self.reports.get(f'{node}: {key}', '')


@pytest.fixture
def page():
    return opened('mass_spring_damper')


def opened(name, **parameters):
    adjustments = Adjustments(shipped.file(name), parameters)
    scenario = adjustments.scenario('estimator')
    found = SimpleNamespace(
        adjustments=adjustments,
        nodes=Nodes(scenario),
        board=Board(),
        controls=controls(adjustments),
    )
    streams = Streams(scenario)
    found.commands = LiveCommands(
        found.nodes, streams, adjustments, found.controls, Pace.usual(adjustments), found.board,
    )  # fmt: skip

    def send(text):
        command = read_command(text)
        if command is None:
            return None
        found.commands.carry_out(command, 0.0)
        return json.loads(found.board._frames[-1])['answer']

    found.send = send
    found.streams = streams
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
        ('{"do": "push", "shares": [1, 2], "n": 1}', 'push: expected the number of an input'),
        ('{"do": "push", "shares": [true], "n": 1}', 'push: expected the number of an input'),
        ('{"do": "path", "points": [[0, 0], [1, 1]], "n": 1}', 'no position in a plane'),
        ('{"do": "carry", "names": ["x"], "values": [1], "n": 1}', 'has published no finite'),
        ('{"do": "limit", "of": "state", "name": "x", "n": 1}', 'the law lqr keeps no limits'),
        ('{"do": "limit", "of": "input", "name": "x", "n": 1}', 'limit: expected the name of'),
        ('{"do": "limit", "of": "input", "name": "f", "value": 1e999, "n": 1}', 'value cannot'),
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


def test_a_limit_is_dragged_and_removed():
    page = opened('cart_pole', law='mpc')
    for command, values in (
        ({'of': 'input', 'name': 'f', 'value': -8}, {'input_limit': [8.0]}),
        ({'of': 'state', 'name': 'x', 'side': 'low', 'value': -1}, {'state_limit.x': [-1.0, inf]}),
        ({'of': 'state', 'name': 'x', 'side': 'high', 'value': 2}, {'state_limit.x': [-1.0, 2.0]}),
        ({'of': 'state', 'name': 'x', 'side': 'low'}, {'state_limit.x': [-inf, 2.0]}),
        ({'of': 'input', 'name': 'f'}, {'input_limit': [inf]}),
    ):
        assert page.send(json.dumps({'do': 'limit', 'n': 1, **command}))['error'] == ''
        assert page.nodes.calls[-1] == ('set_parameters', values, 'controller')
    crossed = {'do': 'limit', 'of': 'state', 'name': 'x', 'side': 'low', 'value': 2.5, 'n': 1}
    assert 'expected low < high, got 2.5 and 2' in page.send(json.dumps(crossed))['error']
    found = limits(page.adjustments)
    assert found['input'] == {'f': [None, None]} and found['reason'] == ''
    assert found['state']['x'] == [None, 2.0] and found['state']['v'] == [None, None]


def test_each_limit_of_an_input_with_two_is_dragged_alone():
    page = opened('cart_pole', input_lower_limit=[0.0])
    for side, value, changed in (
        ('high', 9.0, {'input_limit': [9.0]}),
        ('low', -2.0, {'input_limit': [9.0], 'input_lower_limit': [-2.0]}),
        ('low', -9.0, {'input_limit': [9.0], 'input_lower_limit': [-9.0]}),
        ('low', -5.0, {'input_limit': [9.0], 'input_lower_limit': [-5.0]}),  # alike by chance
    ):
        command = {'do': 'limit', 'of': 'input', 'name': 'f', 'side': side, 'value': value, 'n': 1}
        assert page.send(json.dumps(command))['error'] == ''
        assert page.nodes.calls[-1] == ('set_parameters', changed, 'controller')
    found = limits(page.adjustments)
    assert (found['input'], found['alike']) == ({'f': [-5.0, 9.0]}, [])
    assert limits(opened('cart_pole').adjustments)['alike'] == ['f']
    empty = '{"do": "limit", "of": "input", "name": "f", "side": "low", "n": 1}'
    assert 'limit of f: expected a lowest value' in page.send(empty)['error']


def test_limits_of_states_need_a_law_that_predicts():
    assert 'choose mpc' in limits(opened('cart_pole').adjustments)['reason']
    assert limits(opened('diff_drive').adjustments)['reason'] == 'the model has no input'


def test_limits_of_the_file_are_set_aside_too():
    page = opened('cart_pole', law='mpc', **{'state_limit.x': [-1.0, 1.0]})
    for law, limit in (('lqr', None), ('mpc', [-1.0, 1.0])):
        answer = page.send(f'{{"do": "choose", "what": "law", "value": "{law}", "n": 1}}')
        assert answer['error'] == ''
        assert limits(page.adjustments)['state'].get('x') == limit


def test_a_drawn_path_is_sent_and_its_outcome_is_told():
    page = opened('mass_spring_damper_2d')
    controller, path = page.nodes.reports, page.commands.path
    controller.update({'controller: motions planned': '3', 'controller: motions refused': '1'})
    assert path.described()['state'] == ''
    assert page.send('{"do": "path", "points": [[0, 0], [0.5, 1]], "n": 1}')['error'] == ''
    name, points = page.nodes.calls[-1]
    assert name == 'follow' and points.tolist() == [[0.0, 0.0, 0.0], [0.5, 1.0, 0.0]]
    assert path.described()['state'] == 'planning'
    controller.update({
        'controller: motions refused': '2', 'controller: reason of the last refusal': 'too fast',
    })  # fmt: skip
    assert path.described()['state'] == 'refused'
    assert path.described()['reason'] == 'too fast'
    page.send('{"do": "path", "points": [[0, 0], [0.5, 1]], "n": 2}')
    assert path.described()['state'] == 'planning'
    controller.update({
        'controller: motions planned': '4', 'controller: motion': '1.00 of 2.00 s',
        'controller: remaining distance [m]': '0.5',
    })  # fmt: skip
    assert path.described()['state'] == 'following'
    assert path.described()['remaining'] == '0.5'
    del controller['controller: motion']
    assert path.described()['state'] == 'ended'


@pytest.mark.parametrize(
    'points', ['[[0, 0]]', '[[0, 0], [1]]', '[[0, 0], [1, "1"]]', '[[0, 0], [1, 1e7]]', '[1, 2]']
)
def test_a_path_is_made_of_pairs(points):
    page = opened('mass_spring_damper_2d')
    assert 'expected 2 to 200 pairs' in page.send(f'{{"do": "path", "points": {points}}}')['error']
    assert page.nodes.calls == []


def test_a_path_of_a_submersible_is_in_depth():
    page = opened('submersible')
    page.send('{"do": "path", "points": [[0, -1], [1, -2]]}')
    assert page.nodes.calls[-1][1].tolist() == [[0.0, 0.0, -1.0], [1.0, 0.0, -2.0]]


def test_a_pull_disturbs_all_inputs():
    page = opened('mass_spring_damper_2d')
    assert page.send('{"do": "push", "shares": [1, -0.5]}')['error'] == ''
    name, pushed = page.nodes.calls[-1]
    assert name == 'push' and pushed[1] == -0.5 * pushed[0] != 0.0


def test_the_plant_is_carried_away_and_a_reset_brings_it_back():
    page = opened('mass_spring_damper')
    page.streams.truth = np.array([0.1, 0.2])
    assert page.send('{"do": "carry", "names": ["x"], "values": [2]}')['error'] == ''
    assert page.nodes.calls == [('reconfigure', 'plant', {'initial_state': [2.0, 0.2]})]
    page.send('{"do": "reset"}')
    start = page.adjustments.value('plant', 'initial_state')
    assert page.nodes.calls[1] == ('reconfigure', 'plant', {'initial_state': start})
    page.nodes.calls.clear()
    page.send('{"do": "reset"}')
    assert page.nodes.calls[0] == ('trigger', 'plant/reset')


@pytest.mark.parametrize(
    'fields',
    [
        '"names": ["y"], "values": [1]', '"names": ["x"], "values": [1, 2]',
        '"names": [["x"]], "values": [1]', '"names": ["x"], "values": [1e7]',
        '"names": ["x"], "values": [true]', '"names": [], "values": []',
    ],
)  # fmt: skip
def test_the_plant_is_carried_to_finite_states_alone(fields):
    page = opened('mass_spring_damper')
    page.streams.truth = np.array([0.1, 0.2])
    assert 'expected names of states' in page.send(f'{{"do": "carry", {fields}}}')['error']
    page.commands.pace.lockstep = True
    answer = page.send('{"do": "carry", "names": ["x"], "values": [2]}')
    assert 'expected real time' in answer['error']
    assert page.nodes.calls == []


def test_a_step_leads_to_the_next_reading_of_a_sensor():
    page = opened('mass_spring_damper')
    page.commands.pace.lockstep = True
    page.streams.estimate = np.zeros(2), np.eye(2)
    page.send('{"do": "step", "reading": "position"}')  # none has been read yet: one step
    page.send('{"do": "step", "reading": "position"}')
    assert page.nodes.calls == [('run_until', 0.015)]
    page.streams._read['position'], page.streams._origin = 0.1, 0
    page.streams._last = 130_000_000
    page.send('{"do": "step", "reading": "position"}')
    page.send('{"do": "step", "reading": "position"}')
    rate = page.adjustments.value('plant', 'position.rate')
    assert page.nodes.calls[-1] == ('run_until', pytest.approx(0.1 + 1.0 / rate + 0.005))


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


@pytest.mark.slow
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


def test_a_reset_begins_anew_for_the_tabs(page):
    page.streams._sum = 5.0
    assert page.send('{"do": "reset", "n": 1}')['error'] == ''
    assert '{"fresh":true}' in page.board._frames
    assert page.streams._sum == 0.0


def test_limits_of_states_are_back_with_the_law_that_keeps_them():
    page = opened('cart_pole')

    def choose(law):
        assert (
            page.send(f'{{"do": "choose", "what": "law", "value": "{law}", "n": 1}}')['error']
            == ''
        )
        return page.nodes.calls[-1]

    choose('mpc')
    limit = '{"do": "limit", "of": "state", "name": "x", "side": "high", "value": 0.8, "n": 2}'
    assert page.send(limit)['error'] == ''
    kept = page.adjustments.value('controller', 'state_limit.x')
    for law, limit in (('lqr', {}), ('placement', {}), ('mpc', {'state_limit.x': kept})):
        assert choose(law) == ('set_parameters', {'law': law, **limit}, 'controller')
        started = page.adjustments.at_start('controller')  # as when lockstep is chosen
        assert started.get('law') == (law if limit else None)
        assert started.get('state_limit.x') == limit.get('state_limit.x')
    assert page.adjustments.value('controller', 'state_limit.x') == kept
    assert limits(page.adjustments)['state']['x'] == [None, 0.8]


def test_a_push_is_known_until_its_end(page):
    assert not page.commands.pushing
    assert page.send('{"do": "push", "n": 1}')['error'] == ''
    assert page.commands.pushing


def test_a_sensor_is_moved_and_the_estimator_does_not_know():
    page = opened('two_bearings')
    command = '{"do": "place", "sensor": "west", "x": -17, "y": 3.5, "n": 1}'
    assert 'no finite state' in page.send(command)['error']
    page.streams.truth = np.array([1.0, 2.0, 3.0, 4.0])
    assert page.send(command)['error'] == ''
    what, node, values = page.nodes.calls[-1]
    assert (what, node, values['west.position']) == ('reconfigure', 'plant', [-17.0, 3.5])
    assert values['initial_state'] == [1.0, 2.0, 3.0, 4.0]
    assert places(page.adjustments)['west'] == [-17.0, 3.5]
    assert page.adjustments.value('estimator', 'west.position') != [-17.0, 3.5]
    wests = ('"x": 1', '"x": 1e9, "y": 2')
    for wrong in ('"sensor": "north", "x": 1, "y": 2', *(f'"sensor": "west", {w}' for w in wests)):
        found = page.send(f'{{"do": "place", {wrong}, "n": 2}}')
        assert 'place: expected a sensor on the map' in found['error']
    page.commands.pace.lockstep = True
    assert 'expected real time' in page.send(command)['error']


@pytest.mark.parametrize('name', ['bearing_tracker', 'sound_tracker', 'cart_pole'])
def test_a_sensor_that_moves_or_publishes_nothing_is_not_moved(name):
    assert places(opened(name).adjustments) == {}


def test_after_a_pause_in_real_time_the_estimator_goes_on_from_its_last_belief(page):
    page.streams.estimate = np.array([0.3, -0.2]), np.diag([0.04, 0.09])
    page.send('{"do": "pause", "n": 1}')
    assert page.send('{"do": "resume", "n": 2}')['error'] == ''
    belief = {'initial_estimate': [0.3, -0.2], 'initial_std': [0.2, pytest.approx(0.3)]}
    assert page.nodes.calls == [
        ('run_until', -1.0), ('reconfigure', 'estimator', belief), ('run_until', FOREVER),
    ]  # fmt: skip
    page.nodes.calls.clear()
    page.send('{"do": "reset", "n": 3}')  # the belief of the file again
    initial = {name: page.adjustments.value('estimator', name) for name in belief}
    assert ('reconfigure', 'estimator', initial) in page.nodes.calls
    assert ('trigger', 'estimator/reset') not in page.nodes.calls
    page.nodes.calls.clear()
    page.send('{"do": "reset", "n": 4}')
    assert ('trigger', 'estimator/reset') in page.nodes.calls


def test_a_pause_before_the_first_estimate_ends_with_the_initial_belief(page):
    page.send('{"do": "pause", "n": 1}')
    page.send('{"do": "resume", "n": 2}')
    assert page.nodes.calls[1] == ('trigger', 'estimator/reset')
