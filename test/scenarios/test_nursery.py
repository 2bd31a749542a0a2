# SPDX-License-Identifier: Apache-2.0
"""A node that was forked does what its executable does."""

import nursery
import pytest

pytest.importorskip('rclpy')

from kalman_ros.harness import Run
from kalman_ros.harness.executables import executable
from kalman_ros.harness.process import NodeProcess, isolated


def recorded(executables):
    nursery.choose(executables)
    with Run() as run:
        run.advance(0.5)
        return {topic: list(messages) for topic, messages in run.recorder.raw.items()}


def test_forked_nodes_publish_the_same_bytes_as_executables():
    executed, forked = recorded(True), recorded(False)
    assert len(executed['estimate']) > 40
    assert forked == executed


@pytest.mark.parametrize(('number', 'code'), [(2, 0), (15, 0), (9, -9)])
def test_a_signal_ends_a_forked_node_with_the_code_of_its_executable(number, code):
    with Run(nodes=('plant',)) as run:
        process = run.processes['plant']
        assert process.exit_code is None
        process.signal(number)
        assert process.wait(20.0)
        assert process.exit_code == code
        run.processes.clear()


@pytest.mark.parametrize('arguments', [['--help'], ['--ros-args', '-p', 'rate']])
def test_a_forked_node_writes_and_exits_as_its_executable(arguments, tmp_path):
    said = []
    for executables in (True, False):
        nursery.choose(executables)
        command = [str(executable('plant')), *arguments]
        process = NodeProcess('plant', command, isolated(0), tmp_path / 'log')
        assert process.wait(60.0)
        said.append((process.exit_code, process.output()))
    assert said[0][1]
    assert said[1] == said[0]
