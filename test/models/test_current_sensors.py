# SPDX-License-Identifier: Apache-2.0
"""A measurement matrix that can be inverted, and why a filter is worth it all the same."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis import checks as verdicts
from kalman_ros.simulation import closed_loop

C = np.array([[1.0, 1.0], [0.0, 1.0]])


@pytest.mark.slow
def test_inverting_the_sensors_is_right_but_noisy():
    built = scenario.build({'model': 'current_sensors'})
    theory = verdicts.theory(built)
    run = closed_loop.run(built, theory.feedback.gain, 30.0, 0)
    assert all(check.passed for check in verdicts.checks(built, theory, run))
    settled = run.time > 2.0
    inverted = np.linalg.solve(C, run.readings['currents'].values[settled].T).T
    raw = inverted - run.truth[settled]
    filtered = run.estimate[settled] - run.truth[settled]
    # C^-1 R C^-T says how noisy, and a steady filter's covariance how much less so
    R = np.diag([0.5**2, 0.3**2])
    noise = np.linalg.solve(C, np.linalg.solve(C, R).T)
    np.testing.assert_allclose(np.cov(raw.T), noise, atol=0.03)
    assert np.all(raw.std(axis=0) > 2.0 * filtered.std(axis=0))
    P = theory.loop.posterior[-1]
    np.testing.assert_allclose(np.cov(filtered.T), P, atol=0.2 * P.max())
    assert np.linalg.eigvalsh(noise - P)[0] > 0.0


def test_with_worthless_dynamics_the_filter_is_the_inverse():
    built = scenario.build({'model': 'current_sensors', 'model_parameters.voltage_noise': 1e6})
    run = closed_loop.run(built, None, 0.5, 0)
    inverted = np.linalg.solve(C, run.readings['currents'].values.T).T
    np.testing.assert_allclose(run.estimate[1:], inverted[1:], atol=1e-3)
