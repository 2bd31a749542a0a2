# SPDX-License-Identifier: Apache-2.0
"""Filters side by side: alike where little is uncertain, and not where much is."""

import numpy as np
import pytest
from tools.compare.cases import CASES
from tools.compare.comparison import measured

from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.simulation.noise import stream

RUNS = 60


def both(name, width, runs=RUNS):
    return [measured(CASES[name], width, filter, runs) for filter in ('ekf', 'ukf')]


WITHIN = chi_square_bounds(1.0, 2.0 / (2 * 200), 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'width', 'low', 'high'),
    [
        ('bearings_only', 0.25, *WITHIN),
        # a distance and a bearing make a sector, which an ellipse fits the worse the longer it is
        ('bearings_only', 1.0, WITHIN[0], 1.6),
        *(('range_bearing', width, *WITHIN) for width in CASES['range_bearing'].widths),
        ('pole', 0.3, *chi_square_bounds(1.0, 2.0 / 200, 1e-3)),
    ],
)
def test_the_truth_is_as_far_from_the_belief_as_that_says(name, width, low, high):
    case, found = CASES[name], []
    for seed in range(200):
        built = case.start(width, stream(seed, 'start'))
        mean, P = built.initial_belief.mean, built.initial_belief.covariance
        measured = built.model.state.indices(case.measured)
        error = built.model.state.subtract(built.initial_state, mean)[measured]
        found.append(nees(error, P[np.ix_(measured, measured)]) / len(measured))
    assert low < np.mean(found) < high


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'runs'), [('bearings_only', RUNS), ('range_bearing', RUNS), ('pole', 3)]
)
def test_where_little_is_uncertain_both_are_alike(name, runs):
    ekf, ukf = both(name, min(CASES[name].widths), runs)
    assert ekf.lost == ukf.lost == 0
    assert 0.7 < np.median(ekf.final) / np.median(ukf.final) < 1.4
    for found in (ekf, ukf):
        assert 0.8 < np.median(found.nees) < 1.4


@pytest.mark.slow
def test_with_range_and_bearing_the_unscented_filter_holds_where_the_extended_one_does_not():
    ekf, ukf = both('range_bearing', 30.0)
    assert ekf.lost > 0.4 * RUNS > 0.2 * RUNS > ukf.lost
    assert np.median(ekf.final) > 3.0 * np.median(ukf.final)
    assert np.median(ekf.nees) > 20.0 > 1.6 > np.median(ukf.nees)


@pytest.mark.slow
def test_with_bearings_only_and_the_published_prior_both_keep_most_tracks():
    ekf, ukf = both('bearings_only', 1.0)
    for found in (ekf, ukf):
        assert found.lost < 0.1 * RUNS
    # but the extended one is sure of itself where it is wrong
    assert np.mean(ekf.nees) > 5.0 * np.mean(ukf.nees)


def test_a_run_whose_error_is_no_number_is_lost():
    ekf, _ = both('range_bearing', 3.0, runs=3)
    assert ekf.lost == 0
    ekf.errors[1, -1] = np.nan
    assert ekf.lost == 1
    assert ekf.summary()['lost'] == 1


def test_every_filter_meets_the_same_truth():
    case = CASES['range_bearing']
    seen = [measured(case, 3.0, filter, 2).errors[:, 0] for filter in ('ekf', 'ukf', 'ekf')]
    np.testing.assert_array_equal(seen[0], seen[1])  # before the first reading
    np.testing.assert_array_equal(seen[0], seen[2])
