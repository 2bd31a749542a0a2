# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.core import Gaussian
from kalman_ros.simulation import closed_loop


def test_for_a_linear_system_the_bound_is_the_covariance_of_the_kalman_filter():
    built = scenario.build({})
    # the bound takes the first belief to hold after the first readings
    run = closed_loop.run(built, None, 1.0, 0, arrives=lambda _, time: time > 0.0)
    P = posterior_cramer_rao(built, run.truth, run.input)
    np.testing.assert_allclose(P, run.covariance, rtol=1e-9, atol=1e-12)


def test_more_noise_bounds_less():
    built = scenario.build({})
    worse = scenario.build({'position.noise': [0.1, 0.1]})
    truth, input = np.zeros((50, 4)), np.zeros((50, 2))
    P, more = (posterior_cramer_rao(each, truth, input) for each in (built, worse))
    assert np.linalg.eigvalsh(more[1:] - P[1:]).min() > -1e-12
    assert more[-1, 0, 0] > 2.0 * P[-1, 0, 0]


def test_a_first_belief_without_any_doubt_is_one_like_another():
    built = scenario.build({})
    certain = replace(built, initial_belief=Gaussian(np.zeros(4), np.zeros((4, 4))))
    truth, input = np.zeros((400, 4)), np.zeros((400, 2))
    P = posterior_cramer_rao(certain, truth, input)
    assert not P[0].any() and np.linalg.eigvalsh(P).min() > -1e-15
    np.testing.assert_allclose(P[-1], posterior_cramer_rao(built, truth, input)[-1], rtol=1e-2)


def test_with_what_was_really_read_the_first_step_counts_and_its_noise_is_used():
    built = scenario.build({})
    run = closed_loop.run(built, None, 1.0, 0)
    P = posterior_cramer_rao(built, run.truth, run.input, run.readings)
    np.testing.assert_allclose(P, run.covariance, rtol=1e-9, atol=1e-12)
    better = {
        name: replace(series, covariance=np.tile(1e-6 * np.eye(2), (len(series.time), 1, 1)))
        for name, series in run.readings.items()
    }
    least = posterior_cramer_rao(built, run.truth, run.input, better)
    assert np.all(least[:, 0, 0] < 0.02 * P[:, 0, 0])


def test_readings_that_did_not_come_leave_the_bound_wide():
    built = scenario.build({})
    truth, input = np.zeros((50, 4)), np.zeros((50, 2))
    lost, due = (posterior_cramer_rao(built, truth, input, read) for read in ({}, None))
    assert lost[-1, 0, 0] > 10.0 * due[-1, 0, 0]


@pytest.mark.parametrize('first', [0, 5])
def test_where_steps_are_missing_as_in_real_time_the_bound_is_the_same(first):
    built = scenario.build({'model': 'level'})
    run = closed_loop.run(built, None, 3.0, 0)
    some = slice(first, None, 10)
    whole = posterior_cramer_rao(built, run.truth, run.input, run.readings)
    sparse = posterior_cramer_rao(
        built, run.truth[some], run.input[some], run.readings, run.time[some]
    )
    np.testing.assert_allclose(sparse, whole[some], rtol=1e-9)
