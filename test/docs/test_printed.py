# SPDX-License-Identifier: Apache-2.0
"""What a page shows as printed is what is printed, at 80 columns."""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from thorough import thorough
from tools.strangers.injected.bag import write_bag
from tools.strangers.injected.recordings import Injection

pytest.importorskip('rclpy')

import kalman_ros as kr
from kalman_ros.analysis.observability import observability
from kalman_ros.analysis.verdict import judge
from kalman_ros.control.limiter import limits_of
from kalman_ros.pipeline.settings import settings
from kalman_ros.programs import design, export
from kalman_ros.programs.replay import program as replay
from kalman_ros.report.run_tables import checks_table
from kalman_ros.scenario.motions import motion_of
from kalman_ros.scenario.reference_motions import along_path

DOCS = Path(__file__).parents[2] / 'docs'


def shown(page, first):
    """Return the lines of the block that begins with a text."""
    blocks = re.findall(r'^```(\w*)\n(.*?)^```$', (DOCS / page).read_text(), re.M | re.S)
    (block,) = (text for kind, text in blocks if not kind and text.startswith(first))
    return [line.rstrip() for line in block.splitlines() if line.strip()]


def contains(printed, lines):
    there = [line.rstrip() for line in printed.splitlines()]
    position = 0
    for line in lines:
        assert line in there[position:], f'not printed: {line}\n{printed}'
        position = there.index(line, position) + 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ('page', 'first', 'argv'),
    [
        ('how_to/design.md', 'Standard deviations', ['cart_pole']),
        thorough(
            'how_to/robust.md', 'Worst case over pole_mass',
            ['cart_pole', '--within', 'pole_mass=0.15..0.25', '--within', 'length=0.25..0.35'],
        ),
    ],
)  # fmt: skip
def test_a_design_is_printed_as_shown(page, first, argv, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv('COLUMNS', '80')
    monkeypatch.chdir(tmp_path)
    try:
        design.main(argv)
    except SystemExit as end:
        assert not end.code
    contains(capsys.readouterr().out, shown(page, first))


@pytest.mark.slow
def test_the_first_demo_is_printed_as_shown():
    # the nodes in lockstep have the same numbers
    run = kr.simulate('mass_spring_damper_2d', seconds=60, seed=0)
    console = Console(width=80)
    with console.capture() as printed:
        console.print(checks_table('', judge(run.scenario, run).checks))
    columns = ' '.join(printed.get().split())
    for line in shown('tutorials/first_loop.md', 'mass_spring')[3:]:
        assert ' '.join(line.split()) in columns, line


def said_on(page):
    """Return the blocks of a page that have one line."""
    blocks = re.findall(r'^```\n(.*)\n```$', (DOCS / page).read_text(), re.M)
    return [block for block in blocks if block.strip()]


def test_an_unknown_parameter_is_refused_as_shown():
    with pytest.raises(ValueError) as error:
        settings({'model': 'mass_spring_damper_2d', 'position.niose': [0.1, 0.1]})
    assert f'estimator: {error.value}' in said_on('tutorials/first_loop.md')


def test_what_no_filter_can_follow_is_refused_as_shown():
    unstable = {
        'model': 'linear', 'sensors': ['speed'], 'speed.measures': ['v'], 'speed.noise': [0.1],
        'speed.type': 'sensor_msgs/JointState', 'speed.fields': ['velocity[0]'],
        'model_parameters.A': [0.5, 0.0, 0.0, -1.0], 'model_parameters.B': [0.0, 1.0],
        'model_parameters.states': ['x', 'v'], 'model_parameters.inputs': ['u'],
        'model_parameters.noise_density': [0.1, 0.1],
    }  # fmt: skip
    with pytest.raises(ValueError) as error:
        observability(settings(unstable).scenario)
    assert f'estimator: {error.value}' in said_on('how_to/drive.md')


@pytest.mark.thorough
@pytest.mark.slow
def test_an_export_is_printed_as_shown(tmp_path, capsys, monkeypatch):
    """Bytes and times are those of a compiler and a machine; all else is the same."""
    pytest.importorskip('casadi')
    monkeypatch.setenv('COLUMNS', '80')
    monkeypatch.chdir(tmp_path)
    export.main(['cart_pole', '--out', 'cart_c'])
    page = (DOCS / 'how_to' / 'embedded.md').read_text()
    (block,) = re.findall(r'^\$ ./dev export cart_pole --out cart_c\n(.*?)\n\$', page, re.M | re.S)
    number = re.compile(r'\d+(\.\d+)?(e-\d+)?')

    def alike(text):
        """Return lines without what a compiler or a machine decides."""
        varies = 'flash', 'stack', 'a step in', 'operations', 'largest', '---'
        lines = [' '.join(line.split()) for line in text.splitlines() if line.strip()]
        return [
            number.sub('#', line) if any(word in line for word in varies) else line
            for line in lines
            if not line.startswith(('---', '───'))
        ]

    assert alike(block) == alike(capsys.readouterr().out)


@pytest.mark.slow
def test_a_replay_is_printed_as_shown(tmp_path, capsys, monkeypatch):
    """But how long it took."""
    monkeypatch.setenv('COLUMNS', '80')
    monkeypatch.chdir(tmp_path)
    write_bag('monday', 'mass_spring_damper', Injection(), 30.0, 3)
    with suppress(SystemExit):
        replay.main(['monday', '--params-file', 'mass_spring_damper'])
    took, files = r'[\d.]+ s, [\d.]+ times', r'In out/.*?png (?=PASS)'
    lines = shown('how_to/record_and_replay.md', 'monday, real time')

    def words(text):
        return re.sub(took, '', re.sub(files, '', ' '.join(text.split())))

    assert words('\n'.join(lines)) == words(capsys.readouterr().out)


@pytest.mark.slow
def test_a_path_beyond_a_limit_is_refused_as_shown():
    robot = kr.load('diff_drive', {'model_parameters.command_time': 0.2})
    corner = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0]])
    limits = limits_of(2, {'input_limit': [np.inf, 2.0]})
    with pytest.raises(ValueError) as error:
        motion_of(robot, along_path(robot, corner, 1.0, 1.0), limits)
    line = f'reference/path: {error.value}; what was held stays'
    assert line in said_on('how_to/follow_a_path.md'), line
