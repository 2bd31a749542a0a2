# SPDX-License-Identifier: Apache-2.0
"""Bearings only, as published: the bound, and tracks that come near it."""

from dataclasses import replace

import numpy as np
import pytest
from thorough import mostly_thorough
from tools.compare.bearings_only import STEP, STEPS, drawn, manoeuvre, moderate
from tools.compare.cases import CASES
from tools.compare.comparison import measured

from kalman_ros import scenario
from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.scenario.regulator import regulator
from kalman_ros.simulation import closed_loop

RUNS = 100
SLOW = pytest.param('gaussian_sum', marks=pytest.mark.slow)
LOST = 1000.0  # m, at the end: ten times the bound


def bound(built, manoeuvre=manoeuvre):
    """Return the bound of position (33,) along the path without noise."""
    x, truth, inputs = built.initial_state, [], []
    for step in range(STEPS + 1):
        truth.append(x)
        inputs.append(manoeuvre(step * STEP))
        x = built.model.step(x, inputs[-1], STEP)
    P = posterior_cramer_rao(built, np.array(truth), np.array(inputs))
    return np.sqrt(np.trace(P[:, :2, :2], axis1=1, axis2=2))


def position_errors(built, filter, seed):
    """Return the error of position at each step of one run, with its prior."""
    belief = drawn(np.random.default_rng(seed))
    run = closed_loop.run(
        replace(built, initial_belief=belief),
        None,
        STEPS * STEP,
        seed,
        filter=filter,
        command=manoeuvre,
        arrives=lambda _, time: time > 0.0,  # the prior has the first direction already
    )
    return np.hypot(*(run.truth - run.estimate)[:, :2].T)


def test_the_bound_has_the_published_scale():
    found = bound(moderate())[[0, 12, 16, 20, 24, 32]] / 1000.0
    low = [1.95, 1.4, 0.45, 0.1, 0.05, 0.08]
    high = [2.05, 1.8, 0.9, 0.14, 0.067, 0.11]
    assert np.all((low <= found) & (found <= high)), found


def test_it_is_the_manoeuvre_that_tells_the_range():
    built = moderate()
    straight = bound(built, lambda time: np.zeros(2))
    assert straight[-1] > 5.0 * bound(built)[-1]


@pytest.mark.thorough
@pytest.mark.parametrize('filter', ['ekf', 'ukf', SLOW])
def test_tracks_come_near_the_bound(filter):
    built = moderate()
    errors = np.array([position_errors(built, filter, seed) for seed in range(RUNS)])
    best, median = bound(built), np.median(errors, axis=0)
    # before the manoeuvre no filter knows the range, after it all but a few do
    assert np.all(median[:13] > 0.5 * best[:13])
    assert median[12] > 1000.0
    assert 0.6 * best[-1] < median[-1] < 1.4 * best[-1]
    lost = np.count_nonzero(errors[:, -1] > LOST)
    assert lost <= 0.08 * RUNS, f'{lost} of {RUNS} tracks are lost'


def test_the_first_belief_is_not_the_truth():
    built = scenario.build({'model': 'bearing_tracker'})
    off = (built.initial_state - built.initial_belief.mean) / built.initial_belief.std
    assert 0.3 < np.hypot(*off[:2]) < 2.0
    assert built.filter == 'gaussian_sum'


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('seed', mostly_thorough(range(3), 0))
def test_a_first_belief_in_quite_another_direction_does_no_harm(seed):
    # 70 degrees off, and nearer than the target: the range alone is right within its deviation
    values = {'model': 'bearing_tracker', 'rate': 1.0, 'initial_estimate': [3500.0, 600.0, 0, 0]}
    built = scenario.build(values)
    gain = regulator(built)[0].gain
    for filter, good in (('gaussian_sum', True), ('ukf', False)):
        run = closed_loop.run(built, gain, 1800.0, seed, filter=filter)
        off = np.hypot(*(run.truth - run.estimate)[-1, :2])
        std = np.sqrt(np.trace(run.covariance[-1, :2, :2]))
        assert (off < 3.0 * std) is np.bool_(good)


@pytest.mark.thorough
@pytest.mark.slow
def test_ranges_side_by_side_keep_what_one_range_loses():
    case, lost, median, sure = CASES['bearings_only'], {}, {}, {}
    for filter in ('ekf', 'ukf', 'gaussian_sum'):
        found = measured(case, 2.0, filter, 60)
        lost[filter], median[filter] = found.lost, np.median(found.final)
        sure[filter] = np.median(found.nees)
    assert lost['gaussian_sum'] <= 1 < lost['ekf']
    assert median['gaussian_sum'] < 0.7 * min(median['ekf'], median['ukf'])
    assert sure['gaussian_sum'] < 1.3 < min(sure['ekf'], sure['ukf'])
