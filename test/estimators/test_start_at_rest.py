# SPDX-License-Identifier: Apache-2.0
"""A start at rest: the tilt by gravity, the heading by the first readings, from any guess."""

import numpy as np
import pytest
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros import sensors
from kalman_ros.core import Gaussian, TimedSensor
from kalman_ros.core import rotations as so3
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.start import likeliest, rested
from kalman_ros.models.inertial import Inertial

MODEL = Inertial(1e-6, 1e-4)
STD = np.repeat([0.05, 2.0, 0.05, 0.02, 0.1], 3)
FIELD = np.array([0.0, 20e-6, -40e-6])
COMPASS = sensors.build('magnetometer', MODEL.state, [1e-6] * 3, {'field': FIELD.tolist()})
#: Rotations about axes in all directions, to the opposite one.
ATTITUDES = [
    angle * axis / np.linalg.norm(axis)
    for angle in (0.0, 1.0, 2.5, np.pi)
    for axis in np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -1, 1], [-1, 2, 0.3]])
]


def at_rest(attitude, gyro=0.004):
    """Return what an IMU reads in an attitude: rates of a bias, and gravity."""
    return np.concatenate((np.full(3, gyro), so3.rotate_back(attitude, MODEL.equilibrium[1][3:])))


def guess(attitude=(0.0, 0.0, 0.0)):
    x = np.zeros(15)
    x[3:6] = attitude
    return Gaussian(x, np.diag(STD**2))


def up(attitude):
    """Return the direction of up in the axes of the body."""
    return so3.rotate_back(attitude, np.array([0.0, 0.0, 1.0]))


@pytest.mark.parametrize('index', mostly_thorough(range(len(ATTITUDES)), 7, 16, 19))
def test_the_tilt_is_that_of_gravity_from_any_guess(index):
    truth = ATTITUDES[index]
    for first in ATTITUDES[::5]:
        found = rested(guess(first), at_rest(truth), MODEL)
        np.testing.assert_allclose(up(found.mean[3:6]), up(truth), atol=0.02)
        # the heading is as unknown as before
        values = np.sqrt(np.linalg.eigvalsh(found.covariance[3:6, 3:6]))
        assert values[1] < 0.05 < 1.2 < values[2]


@pytest.mark.parametrize('index', mostly_thorough(range(len(ATTITUDES)), 7, 16, 19))
def test_a_compass_then_has_the_heading(index):
    truth = ATTITUDES[index]
    online = estimator(guess(), from_rest=True)
    assert online.add_input(0, at_rest(truth)) is Outcome.FUSED
    outcome, _ = online.add_reading('compass', 1, COMPASS.measure(state(truth)))
    assert outcome is Outcome.FUSED
    error = so3.compose(truth, -online.belief.mean[3:6])
    assert np.linalg.norm(error) < 0.05
    # the next input is not that of a body at rest
    before = online.belief.mean
    online.add_input(10_000_000, at_rest(truth) + 0.5)
    np.testing.assert_allclose(online.belief.mean[:12], before[:12], atol=1e-3)


def test_a_compass_that_is_first_counts_as_well():
    truth = ATTITUDES[8]
    online = estimator(guess(), from_rest=True)
    online.add_reading('compass', 0, COMPASS.measure(state(truth)))
    online.add_input(1, at_rest(truth))
    assert np.linalg.norm(so3.compose(truth, -online.belief.mean[3:6])) < 0.05


def test_a_belief_that_is_sure_is_not_turned():
    narrow = Gaussian(guess().mean, 1e-4 * np.eye(15))
    turned = likeliest(narrow, COMPASS.measure(state([0.0, 0.0, np.pi])), COMPASS, MODEL)
    assert np.linalg.norm(turned.mean[3:6]) < 0.5


def test_without_it_nothing_changes():
    plain, rests = (estimator(guess(), from_rest=each) for each in (False, True))
    for online in (plain, rests):
        online.add_input(0, at_rest(ATTITUDES[7]))
    np.testing.assert_array_equal(plain.belief.mean, guess().mean)
    assert np.abs(rests.belief.mean - guess().mean).max() > 0.5


def test_a_linear_model_at_rest_has_no_velocity():
    model = kr.continuous_model([[0, 1], [0, 0]], [0, 1], [0, 0.1])
    found = rested(Gaussian([3.0, 2.0], np.diag([1.0, 25.0])), np.zeros(1), model)
    np.testing.assert_allclose(found.mean, [3.0, 0.0], atol=0.05)
    assert found.std[1] < 0.11


def state(attitude):
    x = np.zeros(15)
    x[3:6] = attitude
    return x


def estimator(belief, **policy):
    plan = Plan(MODEL, {'compass': TimedSensor(COMPASS, 10.0)}, 100.0)
    filter = build_filter('ekf', plan, {})
    return OnlineEstimator(filter, {'compass': COMPASS}, belief, np.zeros(6), Policy(**policy))
