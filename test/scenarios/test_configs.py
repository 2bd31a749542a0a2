# SPDX-License-Identifier: Apache-2.0
"""Every parameter file runs in lockstep over topics, for a short while, and makes sense."""

from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

from kalman_ros.analysis.verdict import consistency
from kalman_ros.harness import Run

CONFIGS = sorted(path.stem for path in (Path(__file__).parents[2] / 'config').glob('*.yaml'))
STEPS = 250


@pytest.mark.parametrize('name', mostly_thorough(CONFIGS, 'diff_drive', 'gnss_imu'))
def test_it_runs_over_topics_and_its_statistics_make_sense(name):
    with Run(name, seed=1) as run:
        run.advance(STEPS / run.scenario.rate)
        loop = run.trajectory()
        wrong = {n: s.message for n, s in run.diagnostics.items() if s.level == b'\x02'}
    assert not wrong
    assert len(loop.time) == STEPS + 1
    for values in (loop.truth, loop.estimate, loop.covariance, loop.input):
        assert np.isfinite(values).all()
    assert np.linalg.eigvalsh(loop.covariance).min() > 0.0
    for sensor, source in run.scenario.enabled.items():
        due = STEPS * source.timed.rate / run.scenario.rate
        assert len(loop.innovations[sensor].nis) == pytest.approx(due + 1, abs=1)
        assert len(loop.readings[sensor].time) == len(loop.innovations[sensor].nis)
    checks = consistency(run.scenario, loop)
    assert len(checks) == run.scenario.model.state.size + len(run.scenario.enabled) + 1
    assert [check.name for check in checks if not check.passed] == []
    if run.scenario.model.input.size:  # the loop holds what it drives
        space, rest = run.scenario.model.state, run.scenario.model.equilibrium
        early, late = np.split(np.abs(space.subtract(loop.truth, rest.state)), [STEPS // 2])
        assert np.all(late.max(axis=0) < 2.0 * early.max(axis=0) + run.scenario.initial_belief.std)
