# SPDX-License-Identifier: Apache-2.0
"""Inertial navigation: many drives at once, and an outage of the satellites."""

import numpy as np
import pytest
from heading_survey import band, scores

from kalman_ros import sensors
from kalman_ros.core import Gaussian, TimedSensor
from kalman_ros.core import rotations as so3
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.batch.batch_filters import batched
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.filter import Plan
from kalman_ros.models.inertial import Inertial

#: A good MEMS IMU: 0.006 degrees per root second, and biases of 0.03 degrees per second.
MODEL, RUNS, DT = Inertial(1e-8, 1e-4, 1e-12, 1e-8), 50, 0.1
SPACE, G = MODEL.state, np.array([0.0, 0.0, 9.80665])
#: Seconds of the drive, and those without fixes.
DRIVE, OUTAGE = 90.0, (20.0, 80.0)


def test_it_falls_without_a_reading_and_rests_with_gravity():
    fallen = MODEL.step(np.zeros(15), np.zeros(6), 2.0)
    np.testing.assert_allclose(fallen[[2, 8]], [-0.5 * G[2] * 4.0, -G[2] * 2.0])
    np.testing.assert_allclose(MODEL.step(np.zeros(15), MODEL.equilibrium.input, 2.0), 0.0)


def test_biases_are_taken_off_and_axes_are_those_of_the_body():
    x = np.zeros(15)
    x[3:6], x[9:12], x[12:] = [0.0, 0.0, np.pi / 2], [0.1, 0.2, 0.3], [0.4, 0.5, 0.6]
    u = np.array([0.1, 0.2, 1.3, 1.4, 0.5, 0.6 + G[2]])
    rate = MODEL.derivative(x, u)
    np.testing.assert_allclose(rate[3:6], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(rate[6:9], [0.0, 1.0, 0.0], atol=1e-15)


def drives():
    """Yield the time, the input with the biases of each run, the truth, and fixes."""
    rng = np.random.default_rng(8)
    Q = DT * MODEL.noise_density(np.zeros(15)).diagonal()
    first = rng.normal(size=(RUNS, 15)) * STD
    x = SPACE.add(np.tile(START, (RUNS, 1)), first)
    for k in range(round(DRIVE / DT)):
        t = k * DT
        pushed = [1.5 * np.cos(0.8 * t), 0.5 * np.sin(0.5 * t), 0.0]
        rate = [0.05 * np.sin(t), 0.05 * np.cos(0.7 * t), 0.4 * np.sin(0.3 * t)]
        force = pushed + so3.rotate_back(x[:, 3:6], G)
        u = np.hstack((rate + x[:, 9:12], force + x[:, 12:]))
        moved = MODEL.step(x, u, DT)
        x = SPACE.add(moved, rng.normal(size=x.shape) * np.sqrt(Q))
        yield t + DT, u, x, x[:, :3] + 0.5 * rng.normal(size=(RUNS, 3))


START = np.zeros(15)
START[5] = 0.7
STD = np.repeat([0.5, 0.02, 0.3, 0.0005, 0.01], 3)


@pytest.mark.slow
def test_through_an_outage_of_a_minute_the_band_covers_the_error():
    gnss = sensors.build('states', SPACE, [0.5] * 3, {'measures': ['x', 'y', 'z']})
    plan = Plan(MODEL, {'gnss': TimedSensor(gnss, 5.0)}, 1.0 / DT)
    filter = batched(build_filter('ekf', plan))
    belief = Gaussian(np.tile(START, (RUNS, 1)), np.tile(np.diag(STD**2), (RUNS, 1, 1)))
    scores, shares = {}, {}
    for k, (t, u, truth, fix) in enumerate(drives()):
        belief = filter.predict(belief, u, DT)
        if k % 2 == 1 and not OUTAGE[0] < t < OUTAGE[1]:
            belief = filter.correct(belief, fix, gnss).posterior
        if k % 50 == 49:
            error = SPACE.subtract(truth, belief.mean)
            scores[round(t)] = nees(error, belief.covariance).mean() / 15.0
            std = np.sqrt(np.diagonal(belief.covariance, axis1=-2, axis2=-1))
            shares[round(t)] = (np.abs(error[:, :3]) < 2.0 * std[:, :3]).mean(), std[:, 0].mean()
    low, high = chi_square_bounds(1.0, 2.0 / (15 * RUNS), 0.001)
    assert all(low < each < high for each in scores.values()), scores
    assert shares[75][1] > 100.0 * shares[20][1]  # from decimetres to tens of metres
    assert all(0.88 < inside < 0.99 for inside, _ in shares.values()), shares


@pytest.mark.slow
def test_hypotheses_find_a_heading_that_is_wrong_by_a_right_angle():
    """One Gaussian, of an extended filter, is about a heading that it cannot be linear in.

    `heading_survey` is the same for 200 runs.
    """
    low, high = band(20)
    found, headings = scores('gaussian_sum', 20)
    assert low < found.mean() < high
    assert headings.max() < 0.6
    assert scores('ekf', 20)[0].mean() > 1.5
