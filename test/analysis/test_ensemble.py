# SPDX-License-Identifier: Apache-2.0
"""Statistics of runs whose outcomes are given."""

from types import SimpleNamespace

import numpy as np
import pytest

from kalman_ros.analysis.ensemble import Ensemble, settling
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.scenario import build

SCENARIO = build({'model': 'mass_spring_damper', 'rate': 100.0})


def ensemble(nees=(1.0, 1.0), lost=None, cost=(), after=0.0, **others):
    nees = np.array(nees)
    outcomes = SimpleNamespace(nees=nees, cost=np.array(cost), **others)
    lost = np.zeros(len(nees), dtype=bool) if lost is None else np.array(lost)
    return Ensemble(SCENARIO, tuple(range(len(nees))), 1.0, after, lost, outcomes)


def test_the_average_nees_has_the_bounds_of_its_scatter():
    nees = [0.8, 1.3, 0.9, 1.2, 50.0]
    found = ensemble(nees, lost=[False] * 4 + [True])
    assert found.anees == pytest.approx(1.05)
    variance = np.var(nees[:4], ddof=1) / 4.0 / 1.05**2
    assert found.anees_bounds == pytest.approx(chi_square_bounds(1.0, variance, 0.05))
    assert found.consistent and found.lost_share == 0.2 and found.runs == 5


@pytest.mark.parametrize(
    ('nees', 'bounds', 'consistent'),
    [
        ([7.0], (0.0, np.inf), True),
        ([1.0, 1.0], (1.0, 1.0), True),
        ([1.1, 1.1], (1.0, 1.0), False),
        ([0.9, 0.9], (1.0, 1.0), False),
    ],
)
def test_runs_without_scatter_are_consistent_if_their_nees_is_one(nees, bounds, consistent):
    found = ensemble(nees)
    assert (found.anees_bounds, found.consistent) == (bounds, consistent)


def test_averages_are_over_runs_that_are_not_lost():
    found = ensemble(
        [1.0, 1.0, 1.0], lost=[False, True, False], cost=[1.0, 99.0, 3.0],
        squared_error=np.array([[1.0, 4.0], [99.0, 99.0], [7.0, 12.0]]),
        nis={
            'a': np.array([1.0, 99.0, np.nan]),
            'b': np.array([2.0, 99.0, 3.0]),
            'none': np.full(3, np.nan),
        },
    )  # fmt: skip
    np.testing.assert_allclose(found.rms, [2.0, np.sqrt(8.0)])
    assert found.nis == {'a': 1.0, 'b': 2.5}
    assert found.cost == pytest.approx(200.0)
    assert found.cost_error == pytest.approx(np.std([1.0, 3.0], ddof=1) / np.sqrt(2.0) * 100.0)


def test_what_no_run_has_is_no_number():
    none = ensemble([1.0, 1.0], lost=[True, True], squared_error=np.ones((2, 2)))
    assert np.isnan(none.anees) and np.isnan(none.rms).all()
    assert np.isnan(none.cost) and np.isnan(none.cost_error)
    assert np.isnan(ensemble([1.0], cost=[2.0]).cost_error)
    assert ensemble([1.0], cost=[2.0]).cost == 200.0


def test_deviations_begin_after_the_start():
    count = np.array([2, 2, 1, 0])
    variance = np.array([[8.0, 2.0], [2.0, 4.0], [3.0, 1.0], [0.0, 0.0]])
    found = ensemble(
        count=count, step_variance=variance, step_nees=np.array([4.0, 8.0, 3.0, 0.0]),
        step_squares=2.0 * variance, after=0.01,
    )  # fmt: skip
    np.testing.assert_allclose(found.std, np.sqrt([5.0 / 3.0, 5.0 / 3.0]))
    np.testing.assert_allclose(found.time, [0.0, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(found.step_anees, [1.0, 2.0, 1.5, 0.0])
    each = variance / np.array([2.0, 2.0, 1.0, 1.0])[:, np.newaxis]
    np.testing.assert_allclose(found.step_std, np.sqrt(each))
    np.testing.assert_allclose(found.step_rms, np.sqrt(2.0 * each))


def test_a_loop_settles_in_half_of_the_time_at_most():
    time = settling(SCENARIO, True, 1e3)
    assert 0.5 < time < 20.0
    assert settling(SCENARIO, True, time) == 0.5 * time
    assert settling(SCENARIO, False, 1e3) == 0.0
    blind = build({'model': 'mass_spring_damper', 'position.enabled': False,
                   'velocity.enabled': False})  # fmt: skip
    assert settling(blind, True, 1e3) == 0.0
