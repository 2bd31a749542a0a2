# SPDX-License-Identifier: Apache-2.0
"""Vehicles that find their way: on wheels alone, and with positions that stop coming."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis.observability import observability
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.simulation import closed_loop

RUNS = 6


def runs(name, seconds, given=None, **options):
    """Return the scenario, and the errors and covariances (RUNS, N, ...) of several runs."""
    given = {'model': name, **(given or {})}
    built = scenario.build(given)
    errors, covariances = [], []
    for seed in range(RUNS):
        # the truth starts where the first belief says that it may
        rng = np.random.default_rng(1000 + seed)
        mean, P = built.initial_belief.mean, built.initial_belief.covariance
        start = rng.multivariate_normal(mean, P).tolist()
        real = scenario.build({**given, 'initial_state': start})
        run = closed_loop.run(real, None, seconds, seed, believed=built, **options)
        errors.append(built.model.state.subtract(run.truth, run.estimate))
        covariances.append(run.covariance)
    return built, np.array(errors), np.array(covariances)


def spread(covariances):
    """Return the standard deviation of position (RUNS, N)."""
    return np.sqrt(np.trace(covariances[..., :2, :2], axis1=-2, axis2=-1))


def test_wheels_and_gyroscope_tell_the_motion_but_not_the_place():
    assert observability(scenario.build({'model': 'diff_drive'})).unseen == ('x', 'y', 'psi')


@pytest.mark.thorough
@pytest.mark.slow
def test_dead_reckoning_knows_how_far_it_may_be_off():
    built, errors, covariances = runs('diff_drive', 8.0)
    n = built.model.state.size
    found = nees(errors[:, -1], covariances[:, -1]).mean() / n
    low, high = chi_square_bounds(1.0, 2.0 / (n * RUNS), 1e-3)
    assert low < found < high
    assert np.all(spread(covariances)[:, -1] > 1.1 * spread(covariances)[:, 100])


@pytest.mark.thorough
@pytest.mark.slow
def test_hypotheses_find_any_heading_in_the_plane():
    """One Gaussian is about a heading that it cannot be linear in."""
    std = [10.0, 10.0, 3.0, 0.1, 0.1, 0.5, 1.0, 1.0]
    given = {
        'rate': 20.0, 'imu.rate': 20.0, 'odometry.rate': 20.0, 'initial_std': std,
        'initial_estimate': [0.0, 0.0, 0.3, 2.0, 0.0, 0.0, 0.0, 0.0],
    }  # fmt: skip
    found = {}
    for kind in ('gaussian_sum', 'ekf'):
        built, errors, covariances = runs('robot_2d', 8.0, {'filter': kind, **given})
        n = built.model.state.size
        found[kind] = nees(errors[:, 79::20], covariances[:, 79::20]).mean() / n
    # successive errors are alike: the band is of that many runs
    low, high = chi_square_bounds(1.0, 2.0 / (n * RUNS), 1e-3)
    assert low < found['gaussian_sum'] < high
    assert found['ekf'] > 5.0


@pytest.mark.slow
def test_two_sources_of_yaw_rate_are_better_than_one():
    alone = scenario.build({'model': 'diff_drive', 'imu.enabled': False})
    both = scenario.build({'model': 'diff_drive'})
    one, two = (closed_loop.run(each, None, 5.0, 0).covariance[-1] for each in (alone, both))
    assert one[3, 3] > 4.0 * two[3, 3]


@pytest.fixture(scope='module')
def outage():
    """Runs of 22 s, in which no position comes from 10 s to 20 s."""
    return runs('gnss_imu', 22.0, arrives=lambda name, t: name != 'gnss' or not 10.0 < t < 20.0)


@pytest.mark.thorough
@pytest.mark.slow
def test_everything_is_observed_where_the_vehicle_moves(outage):
    built, *_ = outage
    assert observability(built).unseen == ()


@pytest.mark.thorough
@pytest.mark.slow
def test_the_biases_of_the_imu_are_found(outage):
    built, errors, covariances = outage
    before = covariances[:, 999, 6:, 6:].diagonal(axis1=1, axis2=2)
    prior = built.initial_belief.covariance.diagonal()[6:]
    assert np.all(np.sqrt(before) < 0.5 * np.sqrt(prior))
    inside = np.abs(errors[:, 999, 6:]) < 3.0 * np.sqrt(before)
    assert inside.mean() > 0.95


@pytest.mark.slow
@pytest.mark.thorough
def test_in_an_outage_the_covariance_grows_and_covers_the_error(outage):
    _, errors, covariances = outage
    position = spread(covariances)
    before, during, after = position[:, 999], position[:, 1000:2000], position[:, 2200]
    assert np.all(np.diff(during[:, 100::100]) > 0.0)
    assert np.all(during[:, -1] > 3.0 * before)
    assert np.all(after < 1.5 * before)
    off = np.hypot(*errors[:, 1000:2000, :2].transpose(2, 0, 1))
    assert np.mean(off < 2.0 * during) > 0.95
    assert np.all(off < 4.0 * during)
    # at the end of the outage, where the runs are independent of each other
    found = nees(errors[:, 1999], covariances[:, 1999]).mean() / errors.shape[-1]
    low, high = chi_square_bounds(1.0, 2.0 / (errors.shape[-1] * RUNS), 1e-3)
    assert low < found < high
    last = errors[:, 1999, :2]
    found = nees(last, covariances[:, 1999, :2, :2]).mean() / 2
    low, high = chi_square_bounds(1.0, 2.0 / (2 * RUNS), 1e-3)
    assert low < found < high
