# SPDX-License-Identifier: Apache-2.0
"""The command that writes C: what it prints, and what it refuses in one line."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.compiled.library import compiler
from kalman_ros.embedded import writing
from kalman_ros.programs import export

pytest.importorskip('casadi')


def refused(capsys, *arguments):
    """Return the line with which a call is refused."""
    with pytest.raises(SystemExit) as ended:
        export.main([*map(str, arguments)])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.slow
@pytest.mark.skipif(not compiler(), reason='there is no C compiler')
def test_it_writes_builds_checks_and_says_the_sizes(capsys, tmp_path):
    export.main(['dc_motor', '--out', str(tmp_path / 'c'), '--name', 'motor'])
    out = capsys.readouterr().out
    assert all(len(line) <= 80 for line in out.splitlines()[1:])
    assert re.search(r'flash: code and constants +\d+ bytes', out)
    assert re.search(r'^PASS: \d+ calls as in Python$', out, re.MULTILINE)
    assert re.search(r'largest difference from Python +\d\.\de-1\d', out)
    assert bool(re.search(r'its operations +\d+', out)) == (shutil.which('c++') is not None)
    files = {each.name for each in (tmp_path / 'c').iterdir()}
    assert files == {'motor.c', 'motor.h', 'check.c', 'vectors.txt', 'Makefile'}


def test_limits_idle_input_and_options_of_the_file_are_carried(tmp_path):
    mine = tmp_path / 'mine.yaml'
    mine.write_text(
        '/**:\n  ros__parameters: {model: dc_motor, filter: kf, sensors: [encoder]}\n'
        'estimator:\n  ros__parameters: {max_gap: 3.0, gate_recover_after: 7}\n'
        'controller:\n  ros__parameters: {input_limit: 2.5, input_rate_limit: 9.0}\n'
    )
    export.main([str(mine), '--out', str(tmp_path / 'c'), '--no-build'])
    text = (tmp_path / 'c' / 'mine.c').read_text()
    for expected in (
        'LOWER[] = {R(-2.5)}', 'UPPER[] = {R(2.5)}', 'RATE[] = {R(9.0)}',
        'MAX_GAP INT64_C(3000000000)', 'RECOVER_AFTER 7',
    ):  # fmt: skip
        assert expected in text


@pytest.mark.thorough
@pytest.mark.slow
def test_the_path_of_a_file_becomes_a_table(tmp_path):
    source = Path(__file__).parents[2] / 'docs' / 'examples' / 'robot_on_a_path.yaml'
    shorter = tmp_path / 'robot.yaml'
    shorter.write_text(re.sub(r'path: \[.*\]', 'path: [0.0, 0.0, 1.0, 0.0]', source.read_text()))
    speed = ['-p', 'path_speed:=0.5']
    export.main([str(shorter), '--out', str(tmp_path / 'c'), '--no-build', *speed])
    text = (tmp_path / 'c' / 'robot.c').read_text()
    states = re.search(r'MOTION_STATE\[\] = \{(.*)\};', text)[1].split(', ')
    end = [float(each[2:-1]) for each in states[-5:]]
    assert end[:2] == pytest.approx([1.0, 0.0], abs=0.01)
    seconds = float(re.search(r'DURATION (.*)', text)[1])
    assert seconds > 1.0 / 0.5
    assert 'void robot_follow(robot_loop *loop);' in (tmp_path / 'c' / 'robot.h').read_text()
    alone = [str(shorter), '--out', str(tmp_path / 'd'), '--no-build', '--estimator-only']
    export.main(alone)
    assert 'MOTION' not in (tmp_path / 'd' / 'robot.c').read_text()


@pytest.mark.slow
def test_a_corner_is_cut_by_the_tolerance_of_the_path(tmp_path):
    source = Path(__file__).parents[2] / 'docs' / 'examples' / 'robot_on_a_path.yaml'
    corner = tmp_path / 'corner.yaml'
    path = 'path: [0.0, 0.0, 1.5, 0.0, 1.5, 1.5]'
    corner.write_text(re.sub(r'path: \[.*\]', path, source.read_text()))
    for tolerance in (0.04, 0.08):
        motion = export.of_file(corner, {'path_tolerance': tolerance}, control=True).law.motion
        x, y = motion.states[:, :2].T
        nearest = np.hypot(x - 1.5, y).min()
        assert 0.9 * tolerance < nearest < 1.1 * tolerance


def test_without_a_compiler_it_says_so(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(writing, 'compiler', lambda: ())
    export.main(['dc_motor', '--out', str(tmp_path / 'c'), '--steps', '5'])
    assert 'for there is no C compiler here' in capsys.readouterr().out


@pytest.mark.slow
def test_a_compiler_that_fails_is_named(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(writing, 'compiler', lambda: ('false',))
    line = refused(capsys, 'dc_motor', '--out', tmp_path / 'c', '--steps', 5)
    assert line.startswith('export: make failed')


def test_it_refuses_in_one_line(capsys, tmp_path):
    (tmp_path / 'file').write_text('')
    for expected, *arguments in (
        ('is there already', 'dc_motor', '--out', tmp_path),
        ('is there already', 'dc_motor', '--out', tmp_path / 'file'),
        ('cannot write to', 'dc_motor', '--out', '/proc/none', '--steps', 5),
        ('name: expected a name for C', 'dc_motor', '--out', tmp_path / 'c', '--name', 'a;b'),
        ('unknown scenario', 'dc_moter', '--out', tmp_path / 'c'),
        (
            'precision: expected float64',
            'dc_motor',
            '--precision',
            'half',
            '--out',
            tmp_path / 'c',
        ),
        ('steps: expected 1 to', 'dc_motor', '--out', tmp_path / 'c', '--steps', -1),
        ("unknown parameter 'lor'", 'dc_motor', '-p', 'lor:=1', '--out', tmp_path / 'c'),
        ('initialize: expected belief', 'dc_motor', '-p', 'initialize:=reading'),
    ):
        assert expected in refused(capsys, *arguments)
    assert not (tmp_path / 'c').exists()


def test_without_casadi_one_line_says_what_to_install(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(writing, 'is_available', lambda: False)
    line = refused(capsys, 'dc_motor', '--out', tmp_path / 'c')
    assert line == 'export: it takes CasADi, which writes formulas: pip install casadi'


@pytest.mark.slow
def test_an_import_takes_no_casadi():
    code = 'import sys, kalman_ros.programs.export as e; print("casadi" in sys.modules)'
    out = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert out.stdout.strip() == 'False', out.stderr


def test_without_make_it_says_so(capsys, tmp_path, monkeypatch):
    found = writing.shutil.which
    monkeypatch.setattr(
        writing.shutil, 'which', lambda tool: None if tool == 'make' else found(tool)
    )
    export.main(['dc_motor', '--out', str(tmp_path / 'c'), '--steps', '5'])
    assert 'It was not built, for there is no make here' in capsys.readouterr().out


def test_single_precision_is_refused_where_it_is_coarse(tmp_path):
    """A northing of thousands of kilometres, to a centimetre."""
    north = kr.make_scenario(
        kr.continuous_model(np.zeros((1, 1)), W=[1e-6], states='north'),
        {'gnss': kr.sensor([[1.0]], 1e-4)},
        rate=10.0,
        initial=([5e6], 1e-4),
        initial_state=[5e6],
    )
    with pytest.raises(ValueError, match=r'^precision: float32 resolves north = 5e\+06 to 0.3'):
        kr.export(north, tmp_path / 'single', precision='float32', control=False)
    assert kr.export(north, tmp_path / 'double', control=False, compile=False)


@pytest.mark.slow
@pytest.mark.parametrize('seconds', [-1.0, np.nan, np.inf])
def test_a_transition_is_a_time(tmp_path, seconds):
    with pytest.raises(ValueError, match='^transition_time: expected at least 0 s, got'):
        kr.export('dc_motor', tmp_path / 'c', transition_time=seconds, compile=False)
    kr.export('dc_motor', tmp_path / 'd', transition_time=0.0, compile=False)
    assert '#define BLEND' not in (tmp_path / 'd' / 'dc_motor.c').read_text()
    kr.export('dc_motor', tmp_path / 'e', compile=False)
    assert '#define BLEND R(0.5)' in (tmp_path / 'e' / 'dc_motor.c').read_text()
