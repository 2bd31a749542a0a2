# SPDX-License-Identifier: Apache-2.0
"""Hypotheses side by side: their moments, their weights, and where they come from."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import Gaussian, Space
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.mixture import Mixture, forecast_nis, reduced
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


@pytest.mark.parametrize(
    ('mean', 'std', 'y'),
    [
        ((30.0, 0.0, 1.0, 0.0), (10.0, 10.0, 1.0, 1.0), 0.5),
        ((3.0, 1.0, 1.0, 0.0), (10.0, 5.0, 1.0, 1.0), 0.3),  # it reaches around the sensor
        ((-20.0, 0.0, -1.0, 2.0), (8.0, 0.5, 1.0, 1.0), -3.13),
    ],
)
def test_hypotheses_of_a_bearing_are_what_sampling_makes_of_belief_and_reading(mean, std, y):
    place = np.array([5.0, -3.0])
    sensor = bearing(noise=0.05, position=place)
    turned = np.diag(std) @ np.eye(4)[[0, 1, 2, 3]] + 0.4 * np.eye(4)[[2, 3, 0, 1]]
    prior = Gaussian(np.array(mean) + np.append(place, (0.0, 0.0)), turned @ turned.T)
    found = sensor.hypotheses(prior, np.array([y]), 8)
    drawn = np.random.default_rng(0).multivariate_normal(*prior, 200_000)
    error = sensor.output.subtract(np.array([y]), sensor.measure(drawn))[:, 0]
    likelihood = np.exp(-0.5 * (error / 0.05) ** 2) / (0.05 * np.sqrt(2.0 * np.pi))
    weights = np.exp(found.log_weights)
    assert weights.sum() == pytest.approx(likelihood.mean(), rel=0.04)
    expected = likelihood @ drawn / likelihood.sum()
    d = drawn - expected
    P = (likelihood * d.T) @ d / likelihood.sum()
    together = Mixture(weights / weights.sum(), found.parts, PLANE)
    scale = np.sqrt(P.diagonal())
    np.testing.assert_allclose((together.mean - expected) / scale, 0.0, atol=0.03)
    np.testing.assert_allclose((together.covariance - P) / np.outer(scale, scale), 0, atol=0.03)
    # and the forecast is that of the belief alone
    predicted = sensor.output.mean(sensor.measure(drawn), np.full(len(drawn), 1.0 / len(drawn)))
    d = sensor.output.subtract(sensor.measure(drawn), predicted)[:, 0]
    f = sensor.output.subtract(found.forecast, predicted)[:, 0]
    assert found.shares @ f == pytest.approx(d.mean(), abs=0.03)
    assert found.shares @ f**2 == pytest.approx(np.mean(d**2), rel=0.05)


def test_each_part_of_the_range_is_as_uncertain_relative_to_it_as_the_next():
    found = bearing().hypotheses(PRIOR, np.array([0.0]), 8)
    ranges = np.array([part.mean[0] for part in found.parts])
    ratio = 20.0 ** (1.0 / 8.0)
    # but for the first, which reaches down to the sensor, and the last, of which little is likely
    np.testing.assert_allclose((ranges[1:] / ranges[:-1])[1:], ratio, rtol=0.1)
    widths = np.array([part.std[0] for part in found.parts]) / ranges
    assert (widths[1:] <= (ratio - 1.0) / np.sqrt(12.0)).all()


@pytest.mark.slow
@pytest.mark.parametrize('rho', [0.0, 0.7])
def test_a_belief_is_divided_where_the_second_order_term_counts(rho):
    """Sampling confirms the term, that of a bearing in closed form, and when it is small."""
    r, along, across = 30.0, 1.5, 0.6
    P = np.diag([along**2, across**2, 1.0, 1.0])
    P[0, 1] = P[1, 0] = rho * along * across
    prior = Gaussian(np.array([r, 0.0, 0.0, 0.0]), P)
    term = (P[0, 0] * P[1, 1] + P[0, 1] ** 2) / r**4
    x = np.random.default_rng(0).multivariate_normal(*prior, 400_000)
    sampled = bearing().measure(x)[:, 0]
    linear = sampled - x[:, 1] / r
    assert np.var(linear) == pytest.approx(term, rel=0.05)
    quarter = np.sqrt(term) / 0.25
    assert bearing(0.95 * quarter).hypotheses(prior, np.zeros(1), 8) is not None
    assert bearing(1.05 * quarter).hypotheses(prior, np.zeros(1), 8) is None


def test_what_may_lie_behind_the_sensor_is_divided_however_narrow_it_is():
    narrow = PRIOR._replace(covariance=np.diag([100.0, 1e-6, 1.0, 1.0]))
    assert bearing().hypotheses(narrow, np.zeros(1), 8) is not None
    assert bearing().hypotheses(narrow._replace(mean=4 * PRIOR.mean), np.zeros(1), 8) is None


@pytest.mark.slow
def test_a_part_is_divided_again_for_a_sensor_that_it_is_close_to():
    """Belief and samples of it agree there; of one linearisation they do not."""
    filter = build_filter('gaussian_sum', scenario.build({'model': 'bearing_tracker'}).plan)
    target = np.array([12.5, 1.05])
    prior = Gaussian(np.array([12.0, 1.0, -1.0, 0.0]), np.diag([4.0, 0.5, 0.1, 0.1]) ** 2)
    drawn = np.random.default_rng(0).multivariate_normal(*prior, 1_000_000)
    belief, weight = prior, np.ones(len(drawn))
    for place in ((0.0, 0.0), (10.0, 0.0)):
        sensor = bearing(position=place)
        y = sensor.measure(target)
        single = filter.ekf.correct(belief, y, sensor).posterior
        before, belief = belief, filter.correct(belief, y, sensor).posterior
        weight *= np.exp(-0.5 * (sensor.measure(drawn) - y)[:, 0] ** 2 / 0.02**2)
    assert any(sensor.hypotheses(part, y, 8) for part in before.parts)
    mean = weight @ drawn / weight.sum()
    std = np.sqrt(weight @ (drawn - mean) ** 2 / weight.sum())
    np.testing.assert_allclose((belief.mean - mean)[:2] / std[:2], 0.0, atol=0.15)
    np.testing.assert_allclose(belief.std[:2], std[:2], rtol=0.15)
    assert np.abs((single.mean - mean)[:2] / std[:2]).max() > 0.5


def test_fewer_parts_have_the_moments_of_all():
    rng = np.random.default_rng(1)
    parts = [Gaussian(rng.normal(size=4), np.diag(rng.uniform(0.5, 2.0, 4))) for _ in range(9)]
    weights = rng.dirichlet(np.ones(9))
    whole = Mixture(weights, parts, PLANE)
    fewer = reduced(weights, parts, PLANE, 4)
    assert len(fewer.parts) == len(fewer.weights) == 4
    np.testing.assert_allclose(fewer.mean, whole.mean, atol=1e-12)
    np.testing.assert_allclose(fewer.covariance, whole.covariance, atol=1e-12)


def test_parts_that_are_alike_are_merged_and_others_are_kept():
    near, far = Gaussian(np.zeros(4), np.eye(4)), Gaussian(np.full(4, 9.0), np.eye(4))
    found = reduced(np.array([0.3, 0.3, 0.4]), [near, far, near], PLANE, 8)
    np.testing.assert_allclose(sorted(found.weights), [0.3, 0.7])
    certain = Gaussian(np.zeros(4), np.diag([0.0, 1.0, 1.0, 1.0]))
    assert len(reduced(np.full(3, 1 / 3), [certain, certain, far], PLANE, 8).parts) == 3


def test_the_nis_of_one_gaussian_is_its_square():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(3, 3))
    S, innovation = root @ root.T, rng.normal(size=3)
    found = forecast_nis(np.ones(1), innovation[None], S[None])
    assert found == pytest.approx(innovation @ np.linalg.solve(S, innovation), rel=1e-9)


def test_the_nis_of_a_mixture_is_chi_square_however_far_apart_its_parts_are():
    rng = np.random.default_rng(3)
    weights = np.array([0.9, 0.099, 0.001])
    means = np.array([[0.0, 0.0], [4.0, -3.0], [400.0, 400.0]])
    roots = np.array([[[1.0, 0.0], [0.5, 0.5]], [[0.1, 0.0], [0.0, 2.0]], np.eye(2)])
    S = roots @ roots.swapaxes(-1, -2)
    chosen = rng.choice(3, 2_000, p=weights)
    y = means[chosen] + np.einsum('rij,rj->ri', roots[chosen], rng.standard_normal((2_000, 2)))
    found = np.array([forecast_nis(weights, each - means, S) for each in y])
    assert found.mean() == pytest.approx(2.0, abs=4.0 * np.sqrt(4.0 / 2_000))
    assert np.mean(found > 9.21) == pytest.approx(0.01, abs=4.0 * np.sqrt(0.01 / 2_000))
    # one part less, and it fails: what had no place in the forecast is far off
    assert forecast_nis(np.ones(1), means[2] - means[:1], S[:1]) > 1e4


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
    # the others are given up
    assert all(np.hypot(*(part.mean[:2] - target)) < 3.0 for part in belief.parts)
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
