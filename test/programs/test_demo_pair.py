# SPDX-License-Identifier: Apache-2.0
"""A demo against another tuning: what is run, and what is shown of both."""

import argparse
import io
import json
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest

pytest.importorskip('rclpy')

from rich.console import Console

from kalman_ros import scenario
from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.verdict import judge
from kalman_ros.harness import NodeError
from kalman_ros.programs import demo, demo_run
from kalman_ros.programs.tunings import tunings
from kalman_ros.report import run_pictures
from kalman_ros.report.pair_pictures import pair
from kalman_ros.report.run_tables import pair_table
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation import closed_loop

matplotlib.use('agg')


def asked(tmp_path, *against, scenario='mass_spring_damper', parameters=()):
    options = argparse.Namespace(
        scenario=scenario, against=list(against), parameters=list(parameters)
    )
    return tunings(options, tmp_path)


@pytest.mark.parametrize(('given', 'lockstep'), [([], True), (['--realtime'], False)])
def test_a_demo_is_in_lockstep_or_in_real_time(given, lockstep, tmp_path, monkeypatch):
    modes = []

    def run(*_, lockstep, **__):
        modes.append(lockstep)
        raise NodeError('enough')

    monkeypatch.setattr(demo_run, 'Run', run)
    with pytest.raises(SystemExit):
        demo.main(['level', '--out', str(tmp_path), *given])
    assert modes == [lockstep]


def test_a_parameter_is_beside_the_one_of_the_file(tmp_path):
    first, second = asked(tmp_path, 'input_cost=[0.1]', 'position.rate := 10.0')
    assert second.parameters == {'input_cost': [0.1], 'position.rate': 10.0}
    assert first.label == 'input_cost=[1.0], position.rate=20.0'
    assert second.label == 'input_cost=[0.1], position.rate=10.0'
    assert second.folder == tmp_path / 'against'


def test_a_change_of_both_is_in_both(tmp_path):
    first, second = asked(tmp_path, 'input_cost=[0.1]', parameters=['input_cost:=[2.0]'])
    assert (first.label, second.label) == ('input_cost=[2.0]', 'input_cost=[0.1]')


def test_a_filter_or_a_file_is_enough(tmp_path):
    first, second = asked(tmp_path, 'ukf', 'cart_pole', scenario='cart_pole_ros2_control')
    assert second.scenario == 'cart_pole'
    assert second.parameters['filter'] == 'ukf'
    assert second.label == 'cart_pole, filter=ukf'
    assert first.label == 'filter=ekf'


def test_without_a_limit_there_is_none(tmp_path):
    (only,) = asked(tmp_path, scenario='cart_pole')
    built = scenario.build({'model': 'cart_pole'})
    assert only.limits(built).upper == 40.0
    first, second = asked(tmp_path, 'input_limit=[2.0]')
    built = scenario.build({'model': 'mass_spring_damper'})
    assert first.limits(built).upper == np.inf
    assert second.limits(built).upper == 2.0
    assert first.label == 'without input_limit'


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('input_cost', r'--against: expected NAME=VALUE, a filter \(kf, .*\) or a parameter file'),
        ('=3', "got '=3'"),
        ('input_costt=3', "unknown parameter 'input_costt'; did you mean 'input_cost'?"),
        ('gone.yaml', "no file 'gone.yaml'"),
        ('seed=3', 'expected another parameter than seed, which both share'),
    ],
)
def test_a_mistake_is_named_before_anything_runs(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        asked(tmp_path, text)


@pytest.fixture(scope='module')
def runs():
    """Two runs with the same noise, and two costs of the input."""
    found = []
    for cost in (1.0, 0.1):
        built = scenario.build({'model': 'mass_spring_damper', 'input_cost': [cost]})
        found.append((built, closed_loop.run(built, feedback(built).gain, 9.0, 0)))
    return found


@pytest.mark.slow
def test_both_are_in_one_picture(runs, tmp_path):
    scenarios, trajectories = zip(*runs)
    axes = pair(scenarios, trajectories, ('dear', 'cheap'), tmp_path / 'against.png')
    assert axes.shape == (3, 2)
    for axis, index in zip(axes[:2, 0], range(2)):
        drawn = {line.get_label(): line.get_ydata() for line in axis.lines}
        np.testing.assert_array_equal(drawn['dear'], trajectories[0].truth[:, index])
        np.testing.assert_array_equal(drawn['cheap'], trajectories[1].truth[:, index])
    efforts = [line.get_ydata()[-1] for line in axes[2, 1].lines]
    rms = [np.sqrt(np.mean(run.input**2)) for run in trajectories]
    np.testing.assert_allclose(efforts, rms)
    low, high = axes[0, 1].get_ylim()
    assert low < -np.abs(trajectories[0].truth - trajectories[0].estimate)[:, 0].max() < high


def printed(table):
    console = Console(width=80, file=io.StringIO())
    console.print(table)
    return console.file.getvalue()


def test_a_table_of_two_keeps_repeated_names_and_what_only_one_has():
    nan = float('nan')
    A = [Check('pole', '', -1.0 + 1.0j, -2.0 + 0j, nan, nan, passed=True)]
    A += [Check('pole', '', -1.0 - 1.0j, -2.0 + 0j, nan, nan, passed=True)]
    A += [Check('pole', '', -7.0 + 0j, -8.0 + 0j, nan, nan, passed=True)]
    B = [Check('NIS', 'm', 1.0, 1.25, 0.5, 1.1, passed=False)]
    text = printed(pair_table('', [A, B]))
    assert [line.split() for line in text.splitlines()[3:]] == [
        ['pole', '-1.00', '±', '1.00j', '-2.00'],
        ['pole', '-7.00', '-8.00'],
        ['NIS', '[m]', '1', '1.25'],
    ]


@pytest.mark.slow
def test_a_demo_of_two_writes_both_and_their_picture(runs, tmp_path, monkeypatch, capsys):
    options = ['mass_spring_damper', '--against', 'input_cost=[0.1]', '--duration', '9']

    def performed(given, _):
        given.duration = 9.0
        return [
            demo.Performed(tuning, SimpleNamespace(scenario=built), run, 1.0, 0, judge(built, run))
            for tuning, (built, run) in zip(tunings(given, given.out), runs)
        ]

    (tmp_path / 'against').mkdir()
    monkeypatch.setattr(demo, 'perform', performed)
    monkeypatch.setattr(run_pictures, 'draw_all', lambda *_: [])  # its pictures have tests
    with pytest.raises(SystemExit) as ended:
        demo.main([*options, '--out', str(tmp_path)])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert 'A: input_cost=[1.0]\nB: input_cost=[0.1]\n' in text
    assert text.count('PASS') == 2
    assert 'RMS of f [N]' in text
    assert (tmp_path / 'against.png').stat().st_size > 20_000
    assert json.loads((tmp_path / 'against' / 'summary.json').read_text())['passed']
