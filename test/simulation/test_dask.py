# SPDX-License-Identifier: Apache-2.0
"""Runs by the workers of a real Dask scheduler; a worker that is killed costs no result."""

import os
import signal

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.simulation import spread as spreading

pytestmark = pytest.mark.slow


def test_a_scheduler_that_is_not_there(monkeypatch):
    pytest.importorskip('distributed', reason='the extra dask is not installed')
    monkeypatch.setattr(spreading, '_PATIENCE', 1.0)
    with pytest.raises(ValueError, match="dask: no scheduler at 'tcp://127.0.0.1:1'"):
        kr.monte_carlo(runs=2, seconds=0.1, dask='tcp://127.0.0.1:1')


def test_without_dask_the_error_names_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'distributed', None)
    with pytest.raises(ValueError, match='dask: it is not installed: pip install distributed'):
        list(spreading.spread(abs, [1], dask='tcp://127.0.0.1:1'))


@pytest.mark.thorough
def test_a_killed_worker_costs_time_not_results():
    distributed = pytest.importorskip('distributed', reason='the extra dask is not installed')
    options = {'runs': 40, 'seconds': 4, 'chunk': 4}
    expected = kr.monte_carlo(**options)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        victim = next(iter(cluster.workers.values())).pid
        killed = []

        def progress(done):
            if not killed:
                os.kill(victim, signal.SIGKILL)
                killed.append(done)

        found = kr.monte_carlo(**options, dask=cluster.scheduler_address, progress=progress)
    assert killed and killed[0] < 40
    np.testing.assert_array_equal(found.outcomes.squared_error, expected.outcomes.squared_error)
    np.testing.assert_array_equal(found.outcomes.cost, expected.outcomes.cost)
