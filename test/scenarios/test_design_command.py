# SPDX-License-Identifier: Apache-2.0
"""The command `design` as a person meets it: what it prints, writes and refuses."""

import json
import os
import signal
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from commands import run_command

pytest.importorskip('rclpy')

from kalman_ros import scenario
from kalman_ros.analysis.design_theory import report
from kalman_ros.harness import executables

ROBOT = Path(__file__).parents[1] / 'packages' / 'pendulum_robot'


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run `design` in a folder of its own, on a terminal of 100 columns."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('COLUMNS', '100')
    return partial(run_command, 'design')


def plain(text):
    return ' '.join(text.split())


def test_a_design_is_printed_written_and_drawn(run, tmp_path):
    code, out, err = run()
    assert (code, err) == (0, '')
    said = plain(out)
    assert 'The input controls x, v_x, y, v_y; the sensors observe x, v_x, y, v_y.' in said
    assert 'regulator -1.41 ± 1.71j decays 0.709 2.21 0.637' in said
    assert 'x [m] 0.05 1 0.02184 0.08457' in said
    assert 'f_y, LQR 0 to 71.2 any, 72.1 0.381 1.4' in said
    assert 'J = 0.7697 a second' in said
    assert 'Warning' not in said
    folder = tmp_path / 'out' / 'mass_spring_damper_2d' / 'design'
    summary = json.loads((folder / 'summary.json').read_text())
    expected = report(scenario.build({}))
    np.testing.assert_allclose(summary['regulator']['gain'], expected.regulator.feedback.gain)
    np.testing.assert_allclose(summary['estimator']['error_std'], expected.estimator.std)
    np.testing.assert_allclose(summary['closed_loop']['cost'], expected.closed_loop.cost)
    lag = expected.regulator.loops[1].estimated.margins.lag
    found = summary['margins']['f_y']['state_estimated']['margins']['lag']
    np.testing.assert_allclose([found['value'], found['frequency']], [lag.value, lag.frequency])
    for name in ('poles', 'uncertainty', 'loops'):
        assert (folder / f'{name}.png').stat().st_size > 10_000


@pytest.mark.thorough
def test_a_small_margin_and_a_delay_are_warned_of(run, tmp_path):
    code, out, _ = run('cart_pole', '--out', 'here')
    assert code == 0
    assert 'Warning: Input f: the LQG loop has small margins, gain 0.729 to 2.12' in plain(out)
    late = run('cart_pole', '--delay', '0.02', '--out', 'here')
    assert late[0] == 0
    assert 'the LQG loop is unstable with 0.02 s of delay; its delay margin is 0.018 s.' in plain(
        late[1]
    )
    assert 'f, LQG unstable' in plain(late[1])
    summary = json.loads((tmp_path / 'here' / 'summary.json').read_text())
    assert summary['margins']['f']['state_estimated']['margins'] is None
    assert len(summary['warnings']) == 1


@pytest.mark.thorough
@pytest.mark.parametrize('name', ['submersible', 'diff_drive', 'bearing_tracker', 'level'])
def test_what_has_no_whole_loop_has_a_part_of_the_report(run, name, tmp_path):
    code, out, err = run(name)
    assert (code, err) == (0, '')
    assert 'the sensors observe' in out.lower()
    assert (tmp_path / 'out' / name / 'design' / 'uncertainty.png').stat().st_size > 10_000


@pytest.mark.thorough
def test_a_model_of_ones_own_by_its_parameter_file(run, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROBOT)
    code, out, err = run('--params-file', ROBOT / 'pendulum.yaml')
    assert (code, err) == (0, '')
    assert 'tau, LQG' in out and 'the sensors observe theta, omega' in out
    assert (tmp_path / 'out' / 'pendulum' / 'design' / 'loops.png').exists()


@pytest.mark.thorough
def test_it_is_of_what_estimator_and_controller_believe(run, tmp_path):
    (tmp_path / 'mine.yaml').write_text("""
/**:
  ros__parameters: {velocity.noise: [0.4, 0.4], input_cost: [2.0, 2.0]}
plant:
  ros__parameters: {velocity.noise: [9.0, 9.0]}
estimator:
  ros__parameters: {velocity.noise: [0.3, 0.3]}
controller:
  ros__parameters: {input_cost: [0.5, 0.5]}
""")
    assert run('mine.yaml', '-p', 'position.rate:=50.0')[0] == 0
    summary = json.loads((tmp_path / 'out' / 'mine' / 'design' / 'summary.json').read_text())
    values = {'velocity.noise': [0.3, 0.3], 'input_cost': [0.5, 0.5], 'position.rate': 50.0}
    expected = report(scenario.build(values))
    np.testing.assert_allclose(summary['regulator']['gain'], expected.regulator.feedback.gain)
    np.testing.assert_allclose(summary['estimator']['error_std'], expected.estimator.std)


BLIND = ['-p', 'model:=linear', '-p', 'model_parameters.A:=[0.5, 0.0, 0.0, -1.0]']


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (['mass_spring'], "scenario: unknown scenario 'mass_spring'; did you mean 'mass_spring"),
        (['nowhere.yaml'], "scenario: no file 'nowhere.yaml'"),
        (['--params-file', 'nowhere.yaml'], "No such file or directory: 'nowhere.yaml'"),
        (['--params-file', '.'], "Is a directory: '.'"),
        (['-p', 'input_cost:=[0.0, 1.0]'], 'input_cost: expected a positive definite matrix'),
        (['-p', 'input_cost'], "-p: expected NAME:=VALUE, got 'input_cost'"),
        (['-p', 'input_cost:=[1.0'], "-p: expected NAME:=VALUE, got 'input_cost:=[1.0'"),
        (['-p', 'inptu_cost:=[1.0, 1.0]'], "unknown parameter 'inptu_cost'; did you mean"),
        (['--delay', '-1'], 'delay: expected 0 to 1 s, got -1'),
        (['--delay', 'nan'], 'delay: expected 0 to 1 s, got nan'),
        (['linear', *BLIND, '-p', 'model_parameters.B:=[0.0, 1.0]'], 'input: it does not move'),
        (
            [
                'linear',
                *BLIND,
                '-p',
                'model_parameters.B:=[1.0, 1.0]',
                '-p',
                'position.C:=[0.0, 1.0]',
            ],
            'no sensor sees the growing mode',
        ),
        (['-p', 'position.fields:=[pose.pose.position.q, pose.pose.position.y]'], 'position: '),
        (['-p', 'position.type:=nav_msgs/Odometri'], 'position: '),
        (['turn_rate', '--duration', '0'], 'duration: expected 0.04 to 1000 s, got 0'),
        (['--out', 'taken'], 'out: cannot make taken: File exists'),
    ],
)
def test_what_is_wrong_is_one_line(run, arguments, says, tmp_path):
    (tmp_path / 'taken').write_text('a file, not a folder')
    code, out, err = run(*arguments)
    assert (code, out) == (2, ''), out
    assert err.startswith('design: ') and says in err
    assert len(err.strip().splitlines()) == 1, err


@pytest.mark.thorough
@pytest.mark.parametrize(('number', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_it_without_a_traceback(number, code, tmp_path):
    """Sent while the parameter file is read: it is a pipe, still empty."""
    pipe = tmp_path / 'pipe.yaml'
    os.mkfifo(pipe)
    process = subprocess.Popen(
        [str(executables.executable('design')), '--params-file', str(pipe)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    with pipe.open('w'):  # returns once the program has opened it
        process.send_signal(number)
        output, _ = process.communicate(timeout=30)
    assert process.returncode == code, output
    assert 'Traceback' not in output
