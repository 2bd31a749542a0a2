# SPDX-License-Identifier: Apache-2.0
"""Signals at any moment: while a node starts, during a step, while a command loads; also twice."""

import os
import random
import re
import signal
import subprocess
import time

import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

from kalman_ros.harness import Run, executables
from kalman_ros.harness.domain import Domain

ASKED = (signal.SIGINT, signal.SIGTERM)
NODES = ('plant', 'estimator', 'controller', 'monitor')
#: A line of a traceback that is in the package.
OURS = re.compile(r'File ".*/kalman_ros/\w+(/\w+)*\.py"')


#: CPython prints this, and goes on, where SIGINT arrives before it runs the program's first line.
SWALLOWED = 'Failed checking if argv[0] is an import path entry'


def ends(process, number):
    """Return how a process ended, and what is wrong with that; '' if nothing is."""
    try:
        output, _ = process.communicate(timeout=20.0)
    except subprocess.TimeoutExpired:
        # a second Ctrl-C, as a person would; only where the interpreter has taken the first
        os.killpg(process.pid, number)
        try:
            output, _ = process.communicate(timeout=20.0)
        except subprocess.TimeoutExpired:
            process.kill()
            return f'it did not end: {process.communicate()[0]}'
        if SWALLOWED not in output:
            return f'it ended at the second signal alone: {output}'
        return ''
    # before the first line of ours a signal does what it does to any Python
    early = {-number, 128 + number, 1} if number == signal.SIGINT else {-number}
    if process.returncode and (process.returncode not in early or '[INFO]' in output):
        return f'exit code {process.returncode}: {output}'
    if OURS.search(output) or ('Traceback' in output and not process.returncode):
        return output
    return ''


@pytest.mark.thorough
@pytest.mark.parametrize('twice', [False, True])
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_any_moment_of_the_start(number, twice):
    rng = random.Random(f'{number} {twice}')
    domain = Domain()
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain.id)}
    try:
        for _ in range(6):
            started = time.monotonic()
            processes = {
                name: subprocess.Popen(
                    [str(executables.executable(name))],
                    env=environment,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    text=True,
                    start_new_session=True,
                )
                for name in NODES
            }
            moments = sorted((rng.uniform(0.0, 1.5), name) for name in NODES)
            for moment, name in moments:
                left = started + moment - time.monotonic()
                with pytest.raises(subprocess.TimeoutExpired):  # it runs until it is stopped
                    processes[name].wait(max(left, 0.0))
                for _ in range(1 + twice):
                    os.killpg(processes[name].pid, number)
            wrong = [(m, name, ends(processes[name], number)) for m, name in moments]
            assert not [case for case in wrong if case[2]]
    finally:
        domain.close()


@pytest.mark.thorough
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_node_waits_for_its_parameter_file(number, tmp_path):
    pipe = tmp_path / 'nobody_writes.yaml'
    os.mkfifo(pipe)
    process = subprocess.Popen(
        [str(executables.executable('controller')), '--ros-args', '--params-file', str(pipe)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(4.0)
    for _ in range(2):
        os.killpg(process.pid, number)
    assert not ends(process, number)


@pytest.mark.thorough
@pytest.mark.parametrize('number', mostly_thorough(ASKED, signal.SIGTERM))
@pytest.mark.parametrize('lockstep', mostly_thorough([True, False], True))
def test_a_signal_during_a_step(lockstep, number):
    for node in NODES:
        with Run(lockstep=lockstep) as run:
            run.set_parameter('run_until', 1e6)
            run.wait(lambda: run.elapsed > 0.3, 20.0, lambda: 'the loop stands')
            process = run.processes.pop(node)
            for _ in range(2):
                process.signal(number)
            assert process.wait(10.0), node
            assert process.exit_code == 0, process.output()
            assert 'Traceback' not in process.output()


@pytest.mark.thorough
@pytest.mark.parametrize('command', ['demo', 'study', 'replay', 'design'])
def test_a_command_that_is_interrupted_while_it_loads_says_nothing(command):
    rng = random.Random(command)
    for _ in range(4):
        process = subprocess.Popen(
            [str(executables.executable(command)), '--help'],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            process.wait(rng.uniform(0.0, 1.0))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGINT)
        assert ends(process, signal.SIGINT) == ''
