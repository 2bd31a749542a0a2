# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from random_systems import random_problem

from kalman_ros import models
from kalman_ros.core import Gaussian
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.sensors.states import States


@pytest.mark.parametrize('seed', range(10))
def test_the_filter_is_batch_least_squares(seed):
    """The last state of the whole posterior, from all readings at once."""
    rng, system, sensor, prior = random_problem(seed)
    n, steps = 4, 6
    filter = KalmanFilter(system)
    dts, us = rng.uniform(0.01, 0.2, steps), rng.normal(size=(steps, 2))
    ys = rng.normal(size=(steps, 2))
    belief = prior
    for dt, u, y in zip(dts, us, ys):
        belief = filter.correct(filter.predict(belief, u, dt), y, sensor).posterior

    unknowns = n * (steps + 1)
    information, vector = np.zeros((unknowns, unknowns)), np.zeros(unknowns)

    def add(J, residual_at_zero, covariance):
        weighted = J.T @ np.linalg.inv(covariance)
        information[:] += weighted @ J
        vector[:] += weighted @ residual_at_zero

    first = np.eye(n, unknowns)
    add(first, prior.mean, prior.covariance)
    for step, (dt, u, y) in enumerate(zip(dts, us, ys)):
        sampled = system.sampled(dt)
        J = np.zeros((n, unknowns))
        J[:, n * step : n * (step + 1)] = -sampled.F
        J[:, n * (step + 1) : n * (step + 2)] = np.eye(n)
        add(J, sampled.G @ u, sampled.Q)
        J = np.zeros((2, unknowns))
        J[:, n * (step + 1) : n * (step + 2)] = sensor.C
        add(J, y, sensor.covariance)
    covariance = np.linalg.inv(information)
    np.testing.assert_allclose(belief.mean, (covariance @ vector)[-n:], atol=1e-9)
    np.testing.assert_allclose(belief.covariance, covariance[-n:, -n:], atol=1e-9)


@pytest.mark.parametrize('seed', range(5))
def test_the_filter_equals_filterpy(seed):
    filterpy = pytest.importorskip('filterpy.kalman')
    rng, system, sensor, prior = random_problem(seed)
    ours, belief = KalmanFilter(system), prior
    theirs = filterpy.KalmanFilter(dim_x=4, dim_z=2, dim_u=2)
    theirs.x, theirs.P = prior.mean.copy(), prior.covariance.copy()
    theirs.H, theirs.R = sensor.C, sensor.covariance
    for _ in range(50):
        dt, u, y = rng.uniform(0.01, 0.1), rng.normal(size=2), rng.normal(size=2)
        step = system.sampled(dt)
        theirs.F, theirs.B, theirs.Q = step.F, step.G, step.Q
        theirs.predict(u=u)
        theirs.update(y)
        belief = ours.correct(ours.predict(belief, u, dt), y, sensor).posterior
        np.testing.assert_allclose(belief.mean, theirs.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, theirs.P, rtol=1e-9, atol=1e-9)


def test_a_precise_reading_of_a_vague_state_keeps_the_covariance_definite():
    system = models.find_model('mass_spring_damper')()
    sensor = States(system.state, [1e-7], ('x',))
    belief = Gaussian(np.zeros(2), np.diag([1e8, 1e8]))
    filter = KalmanFilter(system)
    for _ in range(200):
        belief = filter.predict(belief, np.zeros(1), 0.01)
        belief = filter.correct(belief, np.array([1.0]), sensor).posterior
        assert np.linalg.eigvalsh(belief.covariance)[0] >= 0.0


def test_nis_is_the_innovation_in_its_own_units():
    _, system, sensor, prior = random_problem(0)
    y = np.array([0.3, -1.0])
    found = KalmanFilter(system).correct(prior, y, sensor)
    expected = found.innovation @ np.linalg.inv(found.innovation_covariance) @ found.innovation
    np.testing.assert_allclose(found.nis, expected)


def test_an_innovation_covariance_that_is_none_is_an_error():
    _, system, sensor, prior = random_problem(0)
    broken = sensor.with_covariance(-100.0 * np.eye(2))
    with pytest.raises(np.linalg.LinAlgError, match='not positive definite'):
        KalmanFilter(system).correct(prior, np.zeros(2), broken)
