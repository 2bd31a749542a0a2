# SPDX-License-Identifier: Apache-2.0
"""What is said of a process that has ended."""

import os
import signal

import pytest

pytest.importorskip('rclpy')

from kalman_ros.harness.process import NodeProcess

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ('script', 'says'),
    [
        ('echo working; kill -KILL $$', 'ended by SIGKILL'),
        ('echo working; echo cannot go on >&2; exit 3', 'cannot go on'),
        ('exit 3', 'exit code 3'),
    ],
)
def test_the_last_words(tmp_path, script, says):
    process = NodeProcess('node', ['sh', '-c', script], os.environ, tmp_path / 'log')
    assert process.wait(20.0)
    assert process.last_words() == says


def test_a_process_that_ignores_requests_is_killed(tmp_path):
    process = NodeProcess('node', ['sh', '-c', 'trap "" INT TERM; echo up; sleep 60 & wait; wait'],
                          os.environ, tmp_path / 'log')  # fmt: skip
    while 'up' not in process.output():
        assert process.exit_code is None
    process.stop(patience=0.1)
    assert process.exit_code == -signal.SIGKILL
