# SPDX-License-Identifier: Apache-2.0
"""Several processes of pytest count as one."""

import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from side_by_side import closing, exit_code

SCRIPT = Path(__file__).with_name('side_by_side.py')


def test_the_closing_line_counts_both():
    both = Counter(passed=3, failed=1) + Counter(passed=2, skipped=4)
    assert closing(both) == '5 passed, 1 failed, 4 skipped'
    both += Counter(passed=1, rerun=2, broken=1)
    expected = '6 passed, 1 failed, 4 skipped, 2 tried again, 1 of 3 processes broke off'
    assert closing(both) == expected


@pytest.mark.parametrize(
    ('codes', 'one'),
    [((0, 0), 0), ((0, 5), 0), ((5, 5), 5), ((0, 1), 1), ((5, 1), 1), ((-9, 0), 137)],
)
def test_whoever_failed_has_the_exit_code(codes, one):
    assert exit_code(codes) == one


def started(folder):
    """Run the tests of a folder with the options of ours, of which no test has this name."""
    ours = SCRIPT.parent / 'core' / 'test_sensor.py'
    command = [sys.executable, str(SCRIPT), '-q', '-p', 'no:cacheprovider', '-k', 'probe']
    command += [str(ours), str(folder)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.slow
def test_each_part_runs_its_own_and_the_last_line_is_of_both(tmp_path):
    (tmp_path / 'test_timed.py').write_text(
        'import pytest\n'
        '@pytest.mark.real_time\n'
        'def test_probe_1(): pass\n'
        'def test_probe_2(): pass\n'
    )
    (tmp_path / 'test_other.py').write_text('def test_probe_3(): assert False\n')
    process = started(tmp_path)
    output, _ = process.communicate(timeout=100)
    assert process.returncode == 1, output
    assert output.splitlines()[-1] == 'in all: 2 passed, 1 failed, 0 skipped', output


@pytest.mark.slow
def test_an_interrupt_ends_both(tmp_path):
    ready = tmp_path / 'ready'
    os.mkfifo(ready)
    (tmp_path / 'test_long.py').write_text(
        'import signal\n'
        'def test_probe():\n'
        f'    open({str(ready)!r}, "w").close()\n'
        '    signal.pause()\n'
    )
    process = started(tmp_path)
    ready.read_text()  # returns once the test runs
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 130, output
    assert output.splitlines()[-1].startswith('in all: 0 passed'), output
