# SPDX-License-Identifier: Apache-2.0
"""pip installs one command, colcon an executable for each, where `ros2 run` looks."""

import subprocess
import sys
from pathlib import Path

import pytest

from kalman_ros import entry

ROOT = Path(__file__).parents[1]
#: Prints the scripts that a command of setup.py would install.
SCRIPTS = """
import sys, setuptools
setuptools.setup = lambda **given: print(*given['entry_points']['console_scripts'], sep='\\n')
sys.argv[0] = 'setup.py'
exec(compile(open('setup.py').read(), 'setup.py', 'exec'))
"""


def scripts(*argv):
    done = subprocess.run(
        [sys.executable, '-c', SCRIPTS, *argv],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    return [line.partition(' = ')[0] for line in done.stdout.splitlines()]


@pytest.mark.slow
def test_pip_puts_one_command_on_the_path():
    for command in ('bdist_wheel', 'editable_wheel', 'dist_info', 'sdist'):
        assert scripts(command) == ['kalman_ros'], command


@pytest.mark.slow
def test_colcon_installs_each_executable():
    for command in (['egg_info', 'build', 'install'], ['develop']):
        assert sorted(scripts(*command)) == entry.names()


def test_every_name_is_that_of_a_node_or_a_program_and_no_other_is():
    found = entry.names()
    assert {'plant', 'estimator', 'demo', 'study', 'sweep', 'from_robot_localization'} <= {*found}
    assert not {'middleware', 'refusal', 'results', 'demo_run'} & {*found}
    assert all(callable(getattr(entry, name)) for name in found)
    with pytest.raises(AttributeError):
        assert entry.no_such_program


@pytest.fixture
def ran(monkeypatch):
    calls = []
    monkeypatch.setattr(entry, 'design', lambda: calls.append(list(sys.argv)), raising=False)
    return calls


def test_the_one_command_runs_the_others(ran, monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['kalman_ros', 'design', 'cart_pole', '--json'])
    entry.main()
    assert ran == [['design', 'cart_pole', '--json']]


@pytest.mark.parametrize('argv', [[], ['--help']])
def test_alone_it_lists_them(argv, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['kalman_ros', *argv])
    with pytest.raises(SystemExit) as end:
        entry.main()
    assert not end.value.code
    shown = capsys.readouterr().out
    assert all(name in shown for name in entry.names())


def test_an_unknown_one_is_refused(monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['kalman_ros', 'desing'])
    with pytest.raises(SystemExit, match="unknown command 'desing'"):
        entry.main()


@pytest.mark.parametrize(
    ('missing', 'words'), [('rclpy', 'plant: it needs ROS 2'), ('nav_msgs.msg', 'it needs ROS 2')]
)
def test_without_ros_a_node_ends_in_one_line(missing, words, monkeypatch):
    def node():
        raise ModuleNotFoundError(f"No module named '{missing}'", name=missing)

    monkeypatch.setattr(entry, 'plant', node, raising=False)
    monkeypatch.setattr(sys, 'argv', ['kalman_ros', 'plant'])
    with pytest.raises(SystemExit, match=words):
        entry.main()


def test_another_missing_module_is_not_hidden(monkeypatch):
    def node():
        raise ModuleNotFoundError("No module named 'nothing'", name='nothing')

    monkeypatch.setattr(entry, 'plant', node, raising=False)
    monkeypatch.setattr(sys, 'argv', ['kalman_ros', 'plant'])
    with pytest.raises(ModuleNotFoundError):
        entry.main()
