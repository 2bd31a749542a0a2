# SPDX-License-Identifier: Apache-2.0
"""The iterated extended filter finds the likeliest state, and is honest about what is left."""

import numpy as np
import pytest
from scipy.optimize import minimize
from test_on_rotations import MODEL, START, Attitude, spread

import kalman_ros as kr
from kalman_ros.core import Gaussian, Sensor, Space
from kalman_ros.estimators.consistency import nees
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.filters.iterated_ekf import IteratedExtendedKalmanFilter

PLANE = Space('x y', 'm m')
STILL = kr.discrete_model(np.eye(2), Q=1e-9 * np.eye(2))
NEAR = Gaussian(np.array([5.0, 3.0]), 4.0 * np.eye(2))
STD = np.array([0.05, 0.01])


class RangeBearing(Sensor):
    """Range and bearing from the origin, both precise beside a belief that is metres wide."""

    state, output = STILL.state, Space('range bearing', 'm rad', angles='bearing')
    covariance = np.diag(STD**2)

    def measure(self, x):
        return np.stack(
            [np.hypot(x[..., 0], x[..., 1]), np.arctan2(x[..., 1], x[..., 0])], axis=-1
        )


def likeliest(belief, y, sensor, space):
    """Return the least of d' P^-1 d + (y - h)' R^-1 (y - h), searched without derivatives of h."""
    inverse, weight = (np.linalg.inv(each) for each in (belief.covariance, sensor.covariance))

    def cost(d):
        away = sensor.output.subtract(
            y, sensor.measure(space.reached(belief.mean + d, belief.mean))
        )
        return d @ inverse @ d + away @ weight @ away

    start = np.linalg.cholesky(belief.covariance)
    found = minimize(
        lambda v: cost(start @ v), np.zeros(len(belief.mean)), tol=1e-14, options={'gtol': 1e-9}
    )
    return start @ found.x, cost


def test_the_mean_is_the_likeliest_state():
    filter, sensor = IteratedExtendedKalmanFilter(STILL), RangeBearing()
    y = np.array([3.0, 1.2])
    found = filter.correct(NEAR, y, sensor)
    expected, cost = likeliest(NEAR, y, sensor, PLANE)
    d = found.posterior.mean - NEAR.mean
    np.testing.assert_allclose(d, expected, atol=1e-6)
    extended = ExtendedKalmanFilter(STILL).correct(NEAR, y, sensor)
    assert cost(d) < 0.1 * cost(extended.posterior.mean - NEAR.mean)
    # the innovation is that of the belief; the covariance that of the sensor where it is precise
    np.testing.assert_array_equal(found.innovation, extended.innovation)
    assert found.nis == extended.nis
    H = sensor.jacobian(found.posterior.mean)
    information = np.linalg.inv(NEAR.covariance) + H.T @ np.linalg.inv(sensor.covariance) @ H
    np.testing.assert_allclose(found.posterior.covariance, np.linalg.inv(information), rtol=1e-6)


@pytest.mark.parametrize('wide', [2.0, 4.0])
@pytest.mark.parametrize(
    ('coarse', 'wild', 'before'), [(1, 0.001, 0.5), (3, 0.001, 0.2), (10, 0.005, 0.03)]
)
def test_errors_scatter_as_it_says_where_those_of_one_step_do_not(coarse, wide, wild, before):
    """Three readings of each of a thousand places, with noise that is coarse by a factor.

    Of a consistent filter's NEES half are below 1.386, and one of a thousand is above 13.82.
    """
    rng, sensor, runs = np.random.default_rng(0), RangeBearing(), 1000
    sensor.covariance = np.diag((coarse * STD) ** 2)
    places = NEAR.mean + wide * rng.normal(size=(runs, 2))
    seen = [sensor.measure(places) + coarse * STD * rng.normal(size=(runs, 2)) for _ in range(3)]
    found = []
    for kind in (ExtendedKalmanFilter, IteratedExtendedKalmanFilter):
        filter = kind(STILL).stacked()
        P = np.broadcast_to(wide**2 * np.eye(2), (runs, 2, 2))
        belief = Gaussian(np.tile(NEAR.mean, (runs, 1)), P)
        for y in seen:
            belief = filter.correct(belief, y, sensor).posterior
        found.append(nees(places - belief.mean, belief.covariance))
    beyond = [np.mean(each > 13.82) for each in found]
    assert beyond[1] <= wild < before < beyond[0]
    assert np.median(found[1]) == pytest.approx(1.386, abs=0.12)


def test_many_are_corrected_as_each_alone():
    rng, sensor = np.random.default_rng(2), RangeBearing()
    filter = IteratedExtendedKalmanFilter(STILL)
    means = NEAR.mean + rng.normal(size=(40, 2))
    y = sensor.measure(NEAR.mean + 2.0 * rng.normal(size=(40, 2)))
    many = filter.stacked().correct(
        Gaussian(means, np.broadcast_to(NEAR.covariance, (40, 2, 2))), y, sensor
    )
    for index in range(40):
        alone = filter.correct(Gaussian(means[index], NEAR.covariance), y[index], sensor)
        for ours, theirs in zip(many.posterior, alone.posterior):
            np.testing.assert_allclose(ours[index], theirs, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize('turned', [0.3, 2.5])
def test_a_rotation_is_the_likeliest_one(turned):
    """By differences from the first mean, whose axes are not those of the corrected one."""
    sensor, space = Attitude(0.05), MODEL.state
    belief = Gaussian(START, spread(0.4))
    true = space.add(START, turned * np.array([0.3, -0.5, 0.4, 0.1, 0.2, -0.1]))
    y = sensor.measure(true)
    found = IteratedExtendedKalmanFilter(MODEL).correct(belief, y, sensor).posterior
    expected, cost = likeliest(belief, y, sensor, space)
    d = space.subtract(found.mean, START)
    assert cost(d) < cost(expected) + 1e-6
    np.testing.assert_allclose(d, expected, atol=1e-4)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def test_a_step_too_far_is_halved():
    """The zero of an arc tangent, from where Newton's method leads away."""
    model = kr.discrete_model(1.0, Q=1e-9)

    class Saturating(Sensor):
        state, output, covariance = model.state, Space('y'), np.array([[1e-4]])

        def measure(self, x):
            return np.arctan(x)

    belief = Gaussian(np.array([3.0]), np.array([[25.0]]))
    found = IteratedExtendedKalmanFilter(model).correct(belief, np.zeros(1), Saturating())
    assert abs(found.posterior.mean[0]) < 1e-3
    extended = ExtendedKalmanFilter(model).correct(belief, np.zeros(1), Saturating())
    assert extended.posterior.mean[0] < -9.0


def test_a_sensor_that_is_linear_takes_one_step():
    filter = IteratedExtendedKalmanFilter(STILL)
    sensor = kr.sensor([[1.0, 0.5]], 0.3)
    belief = Gaussian(np.ones(2), np.diag([2.0, 3.0]))
    found = filter.correct(belief, np.array([2.0]), sensor).posterior
    plain = ExtendedKalmanFilter(STILL).correct(belief, np.array([2.0]), sensor).posterior
    for ours, theirs in zip(found, plain):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    ('variances', 'y'),
    [([0.0, 1e-2], [6.0, 0.5]), ([1e-4, 1e-4], [np.nan, 0.5]), ([1e-4, 1e-4], [1e200, 0.5])],
)
def test_where_nothing_can_be_lowered_it_is_the_extended_filter(variances, y):
    """Without noise, or without a number, there is no misfit to compare."""
    sensor, y = RangeBearing(), np.array(y)
    sensor.covariance = np.diag(variances)
    many = Gaussian(np.tile(NEAR.mean, (2, 1)), np.stack([NEAR.covariance] * 2))
    both = np.stack([y, [3.0, 1.2]])
    with np.errstate(all='ignore'):
        found, expected = (
            kind(STILL).correct(NEAR, y, sensor).posterior
            for kind in (IteratedExtendedKalmanFilter, ExtendedKalmanFilter)
        )
        together = IteratedExtendedKalmanFilter(STILL).stacked().correct(many, both, sensor)
    for ours, theirs, one in zip(found, expected, together.posterior):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)
        np.testing.assert_allclose(one[0], theirs, rtol=1e-9)
        assert np.isfinite(one[1]).all()


def test_a_scenario_runs_with_it():
    runs = [
        kr.simulate('lidar_radar', overrides={'filter': filter}, seconds=5, seed=1)
        for filter in ('ekf', 'iterated_ekf')
    ]
    extended, iterated = (run.estimate for run in runs)
    assert 0.0 < np.abs(extended - iterated).max() < 0.5
