# SPDX-License-Identifier: Apache-2.0
"""The numbers of a verdict are those that a reader expects: per degree of freedom, per second."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis import checks as verdicts
from kalman_ros.estimators.consistency import nees
from kalman_ros.simulation import closed_loop


@pytest.fixture(scope='module')
def judged():
    """A loop, its theory, a run of it, and its checks by name."""
    built = scenario.build({'model': 'mass_spring_damper'})
    theory = verdicts.theory(built)
    run = closed_loop.run(built, theory.feedback.gain, 14.0, 1)
    return built, theory, run, {c.name: c for c in verdicts.checks(built, theory, run)}


@pytest.mark.slow
def test_the_nees_is_by_its_degrees_of_freedom_and_one_is_expected(judged):
    _, theory, run, found = judged
    check = found['NEES / 2']
    assert check.expected == pytest.approx(1.0)
    errors = (run.truth - run.estimate)[theory.settled :]
    squares = nees(errors, run.covariance[theory.settled :])
    assert check.measured == pytest.approx(np.mean(squares) / 2.0, rel=0.01)
    assert check.low < 1.0 < check.high


def test_the_cost_is_that_of_a_second(judged):
    _, theory, run, found = judged
    check = found['cost J']
    z = np.hstack((run.truth, run.input))[theory.settled :]
    J = np.mean(np.einsum('ki,ij,kj->k', z, theory.cost.weight, z)) / theory.dt
    assert check.measured == pytest.approx(J, rel=0.05)
    assert check.expected == pytest.approx(theory.loop.mean_cost(theory.cost) / theory.dt)
    assert check.low < check.expected < check.high


def test_an_error_is_in_the_unit_of_its_state(judged):
    _, theory, run, found = judged
    check = found['RMS error of x']
    errors = (run.truth - run.estimate)[theory.settled :, 0]
    assert check.measured == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.01)
    assert check.expected == pytest.approx(
        np.sqrt(theory.loop.posterior[:, 0, 0].mean()), rel=0.01
    )
