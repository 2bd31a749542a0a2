# SPDX-License-Identifier: Apache-2.0
"""Filters against their equations, written out here once more as in the textbooks."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from kalman_ros import scenario
from kalman_ros.core import Gaussian, Sensor, Space
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.filters.gaussian_sum import GaussianSumFilter, Mixture
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.estimators.filters.ukf import UnscentedKalmanFilter

SYSTEM = scenario.build({'model': 'mass_spring_damper'})
PRIOR = Gaussian(np.array([0.7, -0.4]), np.array([[0.5, 0.2], [0.2, 0.3]]))


class Square(Sensor):
    """Reads the square of the position, and the velocity times the position."""

    output = Space(('square', 'product'), ('m^2', 'm^2/s'))
    covariance = np.array([[0.1, 0.02], [0.02, 0.2]])

    def measure(self, x):
        return np.stack((x[..., 0] ** 2, x[..., 0] * x[..., 1]), axis=-1)


@pytest.mark.parametrize(('alpha', 'beta', 'kappa'), [(1.0, 0.0, 1.0), (0.5, 2.0, 1.0)])
def test_an_unscented_update_is_that_of_its_weighted_points(alpha, beta, kappa):
    n, (x, P) = 2, PRIOR
    scale = alpha**2 * (n + kappa)
    root = np.linalg.cholesky(scale * P)
    points = np.vstack((x, x + root.T, x - root.T))
    w_mean = np.full(2 * n + 1, 0.5 / scale)
    w_mean[0] = 1.0 - n / scale
    w = w_mean + np.eye(2 * n + 1)[0] * (1.0 - alpha**2 + beta)
    readings = Square().measure(points)
    predicted = w_mean @ readings
    dx, dy = points - x, readings - predicted
    S = (w * dy.T) @ dy + Square.covariance
    K = (w * dx.T) @ dy @ np.linalg.inv(S)
    y = np.array([1.0, 0.5])
    found = UnscentedKalmanFilter(SYSTEM.model, alpha, beta, kappa).correct(PRIOR, y, Square())
    np.testing.assert_allclose(found.innovation_covariance, S, rtol=1e-12)
    np.testing.assert_allclose(found.posterior.mean, x + K @ (y - predicted), rtol=1e-12)
    np.testing.assert_allclose(found.posterior.covariance, P - K @ S @ K.T, atol=1e-13)


def test_hypotheses_are_weighted_by_their_likelihoods():
    """A sure one that is a little off against an unsure one that is right: both terms count."""
    sensor = SYSTEM.sensors['position'].sensor
    parts = [
        Gaussian(np.array([0.3, 0.0]), 0.01 * np.eye(2)),
        Gaussian(np.array([0.0, 0.0]), 4.0 * np.eye(2)),
    ]
    prior = Mixture(np.array([0.4, 0.6]), parts, SYSTEM.model.state)
    filter = GaussianSumFilter(ExtendedKalmanFilter(SYSTEM.model), 2)
    posterior = filter.correct(prior, np.array([0.0]), sensor).posterior
    likelihoods = [
        multivariate_normal.pdf(0.0, part.mean[0], part.covariance[0, 0] + sensor.covariance[0, 0])
        for part in parts
    ]
    expected = prior.weights * likelihoods
    np.testing.assert_allclose(posterior.weights, expected / expected.sum(), rtol=1e-12)


def test_a_steady_gain_is_the_average_of_those_that_repeat():
    values = {'model': 'mass_spring_damper', 'rate': 100.0}
    rates = {'position.rate': 100.0, 'velocity.rate': 50.0}
    plan = scenario.build({**values, **rates}).plan
    assert plan.period == 2
    kf, belief, gains = KalmanFilter(plan.model), PRIOR, {'position': [], 'velocity': []}
    for step in range(4000):
        belief = Gaussian(np.zeros(2), kf.predict(belief, np.zeros(1), plan.dt).covariance)
        for name in plan.due(step):
            sensor = plan.sensors[name].sensor
            after = kf.correct(belief, np.ones(1), sensor).posterior
            gains[name].append(after.mean)  # of an innovation of 1
            belief = Gaussian(np.zeros(2), after.covariance)
    found = build_filter('steady_state', plan).gains
    np.testing.assert_allclose(found['velocity'][:, 0], gains['velocity'][-1], rtol=1e-9)
    first, second = gains['position'][-2:]
    assert np.abs(first - second).max() > 1e-3 * np.abs(first).max()
    np.testing.assert_allclose(found['position'][:, 0], 0.5 * (first + second), rtol=1e-9)
