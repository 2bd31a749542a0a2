# SPDX-License-Identifier: Apache-2.0
"""Sweeps: ranges as typed, what plant and estimator get, theory beside measurement."""

import io
import json

import numpy as np
import pytest
from rich.console import Console
from thorough import thorough

import kalman_ros as kr
from kalman_ros.core import Space
from kalman_ros.programs.sweep import pictures
from kalman_ros.programs.sweep import program as sweep
from kalman_ros.programs.sweep.grid import Point
from kalman_ros.programs.sweep.ranges import Range, parsed
from kalman_ros.programs.sweep.tables import sweep_tables

FEW = ('--runs', '6', '--seconds', '2')


def swept(tmp_path, *arguments):
    sweep.main([*arguments, '--out', str(tmp_path)])
    return json.loads((tmp_path / 'summary.json').read_text())['points']


@pytest.mark.parametrize(
    ('typed', 'name', 'plant', 'believed', 'values'),
    [
        ('input_cost=0.01..100:log:5', 'input_cost', True, True, [0.01, 0.1, 1, 10, 100]),
        ('plant.rate=-1..1:lin:3', 'rate', True, False, [-1, 0, 1]),
        ('estimator.position.noise=.5...9:lin:2', 'position.noise', False, True, [0.5, 0.9]),
    ],
)
def test_ranges(typed, name, plant, believed, values):
    found = parsed(typed)
    assert (found.name, found.plant, found.believed) == (name, plant, believed)
    np.testing.assert_allclose(found.values, values, atol=1e-15)


@pytest.mark.parametrize(
    ('typed', 'says'),
    [
        ('rate', 'expected NAME=LOW..HIGH:log:COUNT'),
        ('rate=1..2', 'expected NAME=LOW..HIGH:log:COUNT'),
        ('rate=1..x:lin:3', "'x' is no number"),
        ('rate=1..nan:lin:3', "'nan' is no number"),
        ('rate=1..2:cubic:3', "expected log or lin, got 'cubic'"),
        ('rate=2..1:lin:3', 'expected a low end below the high one'),
        ('rate=0..1:log:3', 'a log range begins above 0'),
        ('rate=1..2:lin:1', 'expected 2 to 1000 values, got 1'),
        ('input_csot=1..2:lin:2', "did you mean 'input_cost'?"),
        ('plant.mass=1..2:lin:2', "did you mean 'model_parameters.mass'?"),
        ('model=1..2:lin:2', 'expected a parameter with numbers, got model'),
        ('position.noise[7]=1..2:lin:2', 'position.noise has 2 numbers'),
        ('rate[1]=100..200:lin:2', 'rate is one number'),
        ('position.noise=-1..2:lin:2', 'position.noise'),
    ],
)
def test_what_is_refused(typed, says, tmp_path, capsys):
    with pytest.raises(SystemExit) as exit:
        sweep.main(['--over', typed, *FEW, '--out', str(tmp_path)])
    printed = capsys.readouterr().err
    assert exit.value.code == 2 and printed.startswith('sweep: ') and printed.count('\n') == 1
    assert says in printed


@pytest.mark.slow
def test_a_point_without_any_run_left_has_no_anees(tmp_path, capsys):
    typed = 'plant.model_parameters.stiffness=-100..-90:lin:2'
    points = swept(tmp_path, 'mass_spring_damper', '--over', typed, '--runs', '3')
    assert [point['lost'] for point in points] == [1.0, 1.0]
    printed = capsys.readouterr().out
    assert 'nan' not in printed and '*' not in printed


def test_one_parameter_twice_is_refused(tmp_path, capsys):
    twice = ['--over', 'input_cost=1..2:lin:2', '--over', 'input_cost=1..9:lin:3']
    with pytest.raises(SystemExit):
        sweep.main([*twice, *FEW, '--out', str(tmp_path)])
    assert 'over: expected two parameters, got input_cost=1..2' in capsys.readouterr().err


@pytest.mark.slow
def test_cost_and_errors_beside_theory(tmp_path, capsys):
    points = swept(
        tmp_path, '--over', 'input_cost=0.1..10:log:3', '--runs', '60', '--seconds', '10'
    )
    for point in points:
        assert abs(point['cost'] - point['theory_cost']) < 5.0 * point['cost_error']
        for name, rms in point['rms'].items():
            assert rms == pytest.approx(point['theory_rms'][name], rel=0.1)
        assert point['anees'] == pytest.approx(1.0, abs=0.1) and point['lost'] == 0.0
    assert points[0]['cost'] < points[1]['cost'] < points[2]['cost']
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80 and 'theory' in shown
    assert (tmp_path / 'sweep.png').stat().st_size > 10_000


@pytest.mark.thorough
@pytest.mark.slow
def test_averages_begin_after_a_time(tmp_path):
    typed = '--over', 'input_cost=1..2:lin:2', *FEW
    rms = {}
    for after in (0.0, 1.5):
        first, _ = swept(tmp_path, *typed, '--after', str(after))
        rms[after] = [*first['rms'].values()]
        many = kr.monte_carlo(
            'mass_spring_damper_2d', {'input_cost': [1.0, 1.0]}, runs=6, seconds=2.0, after=after
        )
        np.testing.assert_allclose(rms[after], many.rms, rtol=1e-12)
    assert rms[0.0] != rms[1.5]


@pytest.mark.parametrize('after', ['-1', '2', 'nan'])
def test_averages_of_nothing_are_refused(after, tmp_path, capsys):
    with pytest.raises(SystemExit):
        swept(tmp_path, '--over', 'input_cost=1..2:lin:2', *FEW, '--after', after)
    assert 'after: expected 0 to 2 s' in capsys.readouterr().err


@pytest.mark.slow
def test_a_belief_that_is_wrong_is_seen(tmp_path, capsys):
    # the true deviation is 0.05 m: too sure, and too careful
    points = swept(tmp_path, '--over', 'estimator.position.noise=0.03..0.3:log:2', *FEW)
    sure, careful = points
    assert sure['anees'] > sure['anees_bounds'][1]
    assert careful['anees'] < careful['anees_bounds'][0]
    assert all(point['theory_cost'] is None for point in points)
    assert '*' in capsys.readouterr().out


@pytest.mark.slow
def test_faults_of_the_plant_are_swept(tmp_path):
    sound, blind = swept(
        tmp_path, '--over', 'position.dropout=0..1:lin:2', '--runs', '20', '--seconds', '4'
    )
    assert sound['theory_cost'] is not None and blind['theory_cost'] is None
    # without positions the distance drifts by the noise of the velocities
    assert blind['rms']['x'] > 2.0 * sound['rms']['x']
    low, high = blind['anees_bounds']
    assert low < blind['anees'] < high


@pytest.mark.slow
@pytest.mark.thorough
def test_two_parameters_make_a_map(tmp_path):
    points = swept(
        tmp_path, '--over', 'plant.model_parameters.mass=0.5..2:log:2',
        '--over', 'input_cost[0]=0.1..10:log:3', *FEW,
    )  # fmt: skip
    assert len(points) == 6
    assert points[1]['at'] == {'plant.model_parameters.mass': 0.5, 'input_cost[0]': 1.0}
    assert (tmp_path / 'sweep.png').stat().st_size > 10_000


@pytest.mark.parametrize(
    ('names', 'headers'),
    [
        (('position.noise', 'velocity.noise'), ['position.noise', 'velocity.noise']),
        (('position.noise', 'rate'), ['noise', 'rate']),
    ],
)
def test_columns_of_one_name_have_the_whole(names, headers):
    ranges = [Range(name, name, None, True, True, False, (1.0,)) for name in names]
    (table,) = sweep_tables(ranges, Space(('x',), ('m',)), [])
    assert [column.header for column in table.columns][:2] == headers


def test_every_state_is_in_a_table_of_eighty_columns():
    names = tuple(f'state_{k}' for k in range(15))
    (swept,) = [Range('q', 'q', None, True, True, False, (1.0,))]
    point = Point((1.0,), cost=2.0, anees=1.0, anees_bounds=(0.9, 1.1), rms=(0.125,) * 15)
    tables = sweep_tables([swept], Space(names, ('m/s',) * 15), [point])
    console = Console(width=80, record=True, file=io.StringIO())
    for table in tables:
        console.print(table)
    text = console.export_text()
    assert all(f'{name} ' in text for name in names) and '…' not in text
    assert text.count('0.125') == text.count('[m/s]') == 15


@pytest.mark.thorough
@pytest.mark.slow
def test_workers_change_nothing(tmp_path):
    arguments = '--over', 'input_cost=0.1..10:log:3', *FEW
    alone = swept(tmp_path / 'one', *arguments)
    assert alone == swept(tmp_path / 'two', *arguments, '--workers', '2')


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize(
    ('end', 'code', 'says'),
    [
        (KeyboardInterrupt(), 130, 'interrupted'),
        thorough(
            ValueError('workers: a process ended before its work did'), 1, 'workers: a process'
        ),
    ],
)
@pytest.mark.parametrize(
    'over',
    [
        thorough(['input_cost=0.1..10:log:4']),
        ['input_cost=0.1..10:log:2', 'state_cost=1..10:log:2'],
    ],
)
def test_points_that_are_finished_are_kept(end, code, says, over, tmp_path, capsys, monkeypatch):
    def ending(task, items, *_):
        yield 2, task(items[2])
        yield 0, task(items[0])
        raise end

    monkeypatch.setattr(sweep, 'spread', ending)
    typed = [each for one in over for each in ('--over', one)]
    with pytest.raises(SystemExit) as exit:
        sweep.main([*typed, *FEW, '--out', str(tmp_path)])
    assert exit.value.code == code
    assert f'FAIL, 2 of 4 points: {says}' in capsys.readouterr().out
    found = json.loads((tmp_path / 'summary.json').read_text())
    assert says in found['stopped'] and found['missing'] == 2
    costs = [point['at']['input_cost'] for point in found['points']]
    assert costs == pytest.approx([0.1, 10 ** (1 / 3)] if len(over) == 1 else [0.1, 10.0])
    assert (tmp_path / 'sweep.png').stat().st_size > 10_000


def test_a_sweep_without_a_point_is_interrupted(tmp_path, monkeypatch):
    def ending(*_):
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(sweep, 'spread', ending)
    with pytest.raises(KeyboardInterrupt):
        sweep.main(['--over', 'input_cost=0.1..10:log:2', *FEW, '--out', str(tmp_path)])
    assert not (tmp_path / 'summary.json').exists()


@pytest.mark.parametrize(
    ('log', 'values', 'edges'),
    [
        (True, (0.1, 1.0, 100.0), [0.1 / 10**0.5, 10**-0.5, 10.0, 1000.0]),
        (False, (0.0, 1.0, 3.0), [-0.5, 0.5, 2.0, 4.0]),
        (False, (2.0,), [1.5, 2.5]),
    ],
)
def test_a_cell_of_a_map_is_about_its_value(log, values, edges):
    swept = Range('q', 'q', None, True, True, log, values)
    np.testing.assert_allclose(pictures._edges(swept), edges)
