# SPDX-License-Identifier: Apache-2.0
"""Hypotheses side by side: their moments, their weights, and where they come from."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import Gaussian, Space
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.gaussian_sum import Mixture
from kalman_ros.sensors.bearing import Bearing

PLANE = Space(('x', 'y', 'v_x', 'v_y'), ('m', 'm', 'm/s', 'm/s'))
PRIOR = Gaussian(np.array([30.0, 0.0, 1.0, 0.0]), np.diag([10.0, 10.0, 1.0, 1.0]) ** 2)


def bearing(noise=0.02, position=(0.0, 0.0)):
    return Bearing(PLANE, [noise], position=position)


def test_a_mixture_has_the_moments_of_its_parts():
    rng = np.random.default_rng(0)
    weights = np.array([0.2, 0.5, 0.3])
    parts = [Gaussian(rng.normal(size=4), np.diag(rng.uniform(0.5, 2.0, 4))) for _ in weights]
    found = Mixture(weights, parts, PLANE)
    counts = rng.multinomial(200_000, weights)
    drawn = np.vstack([rng.multivariate_normal(*part[:2], n) for part, n in zip(parts, counts)])
    np.testing.assert_allclose(found.mean, drawn.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(found.covariance, np.cov(drawn.T), atol=0.04)
    assert isinstance(found, Gaussian)


def test_angles_on_both_sides_of_pi_are_neighbours():
    space = Space(('psi',), ('rad',), angles=('psi',))
    parts = [Gaussian(np.array([angle]), np.array([[0.01]])) for angle in (3.1, -3.1)]
    found = Mixture(np.array([0.5, 0.5]), parts, space)
    assert abs(found.mean[0]) == pytest.approx(np.pi)
    assert found.std[0] == pytest.approx(np.sqrt(0.01 + (np.pi - 3.1) ** 2))


def test_another_covariance_makes_one_gaussian_of_a_mixture():
    parts = [Gaussian(np.full(4, mean), np.eye(4)) for mean in (0.0, 2.0)]
    found = Mixture(np.array([0.5, 0.5]), parts, PLANE)._replace(covariance=np.eye(4))
    assert type(found) is Gaussian
    np.testing.assert_array_equal(found.mean, np.ones(4))


def test_hypotheses_of_a_bearing_are_ranges_in_its_direction():
    sensor = bearing(position=(5.0, -3.0))
    prior = PRIOR._replace(mean=np.array([35.0, -3.0, 1.0, 0.0]))
    weights, parts = zip(*sensor.hypotheses(prior, np.array([0.5]), 10))
    away = np.array([part.mean[:2] for part in parts]) - [5.0, -3.0]
    # the reading says 0.5 +- 0.02, the belief 0 +- 1/3
    variance = 1.0 / (9.0 + 1.0 / 0.02**2)
    direction = 0.5 * variance / 0.02**2
    np.testing.assert_allclose(np.arctan2(*away.T[::-1]), direction, atol=0.01)
    lines = away / np.hypot(*away.T)[:, None]
    widths = [np.sqrt(u @ p.covariance[:2, :2] @ u) for u, p in zip(lines, parts)]
    distances = np.hypot(*away.T)
    np.testing.assert_allclose(widths / distances, widths[0] / distances[0])
    np.testing.assert_allclose(
        [np.linalg.det(p.covariance[:2, :2]) for p in parts],
        (widths * distances) ** 2 * variance,
        rtol=0.02,
    )
    # together they are what the belief and the reading say, and all else is as it was
    together = Mixture(np.array(weights) / np.sum(weights), parts, PLANE)
    drawn = np.random.default_rng(0).multivariate_normal(prior.mean, prior.covariance, 400_000)
    near = np.exp(-0.5 * sensor.output.subtract(sensor.measure(drawn), 0.5)[:, 0] ** 2 / 0.02**2)
    mean = near @ drawn[:, :2] / near.sum()
    d = drawn[:, :2] - mean
    np.testing.assert_allclose(together.mean[:2], mean, atol=0.6)
    np.testing.assert_allclose(together.covariance[:2, :2], (near * d.T) @ d / near.sum(), atol=12)
    np.testing.assert_allclose(together.mean[2:], prior.mean[2:], atol=1e-12)
    np.testing.assert_allclose(together.covariance[2:, 2:], prior.covariance[2:, 2:])


def test_the_weights_find_the_range_when_another_place_is_looked_from():
    filter = build_filter('gaussian_sum', scenario.build({'model': 'bearing_tracker'}).plan)
    target = np.array([22.0, 11.0])
    belief = PRIOR
    for place in ((0.0, 0.0), (0.0, 20.0)):
        sensor = bearing(position=place)
        y = np.array([np.arctan2(*(target - place)[::-1])])
        belief = filter.correct(belief, y, sensor).posterior
    best = belief.parts[np.argmax(belief.weights)]
    assert belief.weights.sum() == pytest.approx(1.0)
    assert len(belief.parts) <= 2  # on both sides of the edge between two; the others are given up
    assert np.hypot(*(best.mean[:2] - target)) < 1.5
    assert np.hypot(*(belief.mean[:2] - target)) < 1.5
    assert np.sqrt(np.trace(belief.covariance[:2, :2])) < 2.5


def test_what_it_expected_is_what_all_its_parts_expected():
    filter = build_filter('gaussian_sum', scenario.build({'model': 'bearing_tracker'}).plan)
    first, second = bearing(), bearing(position=(0.0, 20.0))
    belief = filter.correct(PRIOR, np.array([0.3]), first).posterior
    correction = filter.correct(belief, np.array([-0.4]), second)
    rng = np.random.default_rng(0)
    counts = rng.multinomial(100_000, belief.weights)
    x = np.vstack([rng.multivariate_normal(*p[:2], n) for p, n in zip(belief.parts, counts)])
    y = second.measure(x)[:, 0] + 0.02 * rng.normal(size=len(x))
    assert correction.innovation[0] == pytest.approx(-0.4 - y.mean(), abs=0.01)
    assert correction.innovation_covariance[0, 0] == pytest.approx(y.var(), rel=0.05)
