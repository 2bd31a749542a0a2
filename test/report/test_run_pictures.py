# SPDX-License-Identifier: Apache-2.0
"""What the pictures of a run claim."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.report.run_pictures import errors
from kalman_ros.simulation import closed_loop

matplotlib.use('agg')


@pytest.fixture(scope='module')
def tracked():
    """A run long enough for its filter to be better than the bound on this path."""
    built = scenario.build({'model': 'bearing_tracker', 'rate': 1.0})
    return built, closed_loop.run(built, None, 400.0, 0)


def drawn_at_best(built, run, tmp_path):
    """Return the upper edge (N, n) of the band at best, in standard deviations."""
    axes = errors(built, run, tmp_path / 'errors.png')
    edges = [axis.collections[0].get_paths()[0].vertices for axis in axes[:, 0]]
    steps = len(run.time)
    return np.array([np.abs(edge[1 : steps + 1, 1]) for edge in edges]).T / 3.0


@pytest.mark.slow
def test_no_band_at_best_is_outside_of_that_of_a_filter_that_is_as_good_as_it_says(
    tracked, tmp_path
):
    built, run = tracked
    bound = posterior_cramer_rao(built, run.truth, run.input, run.readings)
    bound, std = (np.sqrt(P.diagonal(axis1=1, axis2=2)) for P in (bound, run.covariance))
    assert np.any(bound > 1.05 * std)
    np.testing.assert_allclose(drawn_at_best(built, run, tmp_path), np.minimum(bound, std))


def test_a_filter_that_claims_too_much_does_not_move_the_band_at_best(tracked, tmp_path):
    built, run = tracked
    bound = posterior_cramer_rao(built, run.truth, run.input, run.readings)
    boast = replace(run, covariance=run.covariance / 100.0)
    np.testing.assert_allclose(
        drawn_at_best(built, boast, tmp_path), np.sqrt(bound.diagonal(axis1=1, axis2=2))
    )
