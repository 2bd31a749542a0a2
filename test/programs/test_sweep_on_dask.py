# SPDX-License-Identifier: Apache-2.0
"""`sweep --dask` on a scheduler and workers that are processes of this machine."""

import contextlib
import json
import os
import subprocess
import sys

import pytest

from kalman_ros.programs.sweep import program
from kalman_ros.simulation import spread as spreading

pytestmark = pytest.mark.slow
#: Seconds until a process is there.
PATIENCE = 30.0
POINTS = 6
SWEEP = [
    'dc_motor',
    '--over',
    f'input_cost=0.01..1:log:{POINTS}',
    '--runs',
    '20',
    '--seconds',
    '2',
]


@contextlib.contextmanager
def process(module, *arguments, folder=None, stderr=subprocess.DEVNULL):
    command = [sys.executable, '-m', f'distributed.cli.{module}', *arguments, '--no-dashboard']
    with subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=stderr, text=True
    ) as running:
        try:
            yield running
        finally:
            running.kill()


def worker(address, folder=None):
    return process('dask_worker', address, '--no-nanny', '--nthreads', '1', folder=folder)


@pytest.fixture
def address():
    pytest.importorskip('distributed', reason='the extra dask is not installed')
    options = ('--host', '127.0.0.1', '--port', '0')
    with process('dask_scheduler', *options, stderr=subprocess.PIPE) as scheduler:
        found = next((line for line in scheduler.stderr if 'Scheduler at:' in line), '')
        assert found, 'no scheduler'
        yield found.split()[-1]


def wait_for_workers(address, count):
    import distributed

    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=PATIENCE)


def swept(folder, *more):
    program.main([*SWEEP, '--out', str(folder), *more])
    return json.loads((folder / 'summary.json').read_text())


def after_the_first_point(monkeypatch, act):
    """Call ``act`` when the first point is known."""

    def spread(*arguments):
        for count, found in enumerate(spreading.spread(*arguments)):
            if not count:
                act()
            yield found

    monkeypatch.setattr(program, 'spread', spread)


@pytest.mark.thorough
def test_a_worker_killed_half_way_costs_no_point(address, tmp_path, monkeypatch):
    with worker(address) as victim, worker(address):
        wait_for_workers(address, 2)
        after_the_first_point(monkeypatch, victim.kill)
        found = swept(tmp_path / 'dask', '--dask', address)
        assert victim.wait(PATIENCE) < 0
    monkeypatch.undo()
    assert len(found['points']) == POINTS and not found['stopped']
    assert found == swept(tmp_path / 'alone')


def test_without_workers_the_error_is_one_line(address, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(spreading, '_FOR_WORKERS', 1.0)
    with pytest.raises(SystemExit) as ended:
        swept(tmp_path, '--dask', address)
    assert ended.value.code == 2
    assert capsys.readouterr().err == (
        f'sweep: dask: no worker of {address} takes the work: No valid workers found\n'
    )


@pytest.mark.thorough
def test_a_worker_without_this_package_is_named(address, tmp_path, capsys):
    # a module of this name that is no package hides the installed one
    (tmp_path / 'kalman_ros.py').write_text('')
    with worker(address, tmp_path):
        wait_for_workers(address, 1)
        with pytest.raises(SystemExit):
            swept(tmp_path / 'out', '--dask', address)
    error = capsys.readouterr().err
    assert 'takes the work: ModuleNotFoundError' in error and error.count('\n') == 1


@pytest.mark.thorough
def test_a_scheduler_that_ends_leaves_the_finished_points(tmp_path, monkeypatch, address, capfd):
    import distributed

    def end():
        with distributed.Client(address, set_as_default=False) as client:
            os.kill(client.run_on_scheduler(os.getpid), 9)

    with worker(address):
        wait_for_workers(address, 1)
        after_the_first_point(monkeypatch, end)
        with pytest.raises(SystemExit) as ended:
            swept(tmp_path, '--dask', address)
    assert ended.value.code == 1
    found = json.loads((tmp_path / 'summary.json').read_text())
    assert 1 <= len(found['points']) < POINTS and found['missing'] == POINTS - len(found['points'])
    assert f'dask: the workers of {address} are gone' in found['stopped']
    assert 'Traceback' not in capfd.readouterr().err
