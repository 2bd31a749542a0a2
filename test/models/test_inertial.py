# SPDX-License-Identifier: Apache-2.0
"""Inertial navigation: many drives at once, and an outage of the satellites."""

import heading_survey as survey
import numpy as np
import pytest

from kalman_ros import sensors
from kalman_ros.core import Gaussian, Model, Space, TimedSensor
from kalman_ros.core import rotations as so3
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.batch_estimator import for_many
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.plan import Plan
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


def test_scales_multiply_what_is_read_and_jacobians_follow():
    model, rng = Inertial(gyro_scale=1.03, accelerometer_scale=0.98), np.random.default_rng(3)
    x, u = rng.normal(size=15), rng.normal(size=6)
    scaled = u * np.repeat([1.03, 0.98], 3)
    np.testing.assert_allclose(model.derivative(x, u), MODEL.derivative(x, scaled), atol=1e-14)
    np.testing.assert_allclose(
        model.state_jacobian(x, u), Model.state_jacobian(model, x, u), atol=1e-7
    )
    scale = np.repeat([1.03, 0.98], 3)
    np.testing.assert_allclose(
        model.input_jacobian(x, u), MODEL.input_jacobian(x, u) * scale, atol=1e-14
    )
    rest = model.equilibrium
    np.testing.assert_allclose(model.step(rest.state, rest.input, 2.0), 0.0, atol=1e-12)


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


@pytest.mark.thorough
@pytest.mark.slow
def test_through_an_outage_of_a_minute_the_band_covers_the_error():
    gnss = sensors.build('states', SPACE, [0.5] * 3, {'measures': ['x', 'y', 'z']})
    plan = Plan(MODEL, {'gnss': TimedSensor(gnss, 5.0)}, 1.0 / DT)
    filter = for_many(build_filter('ekf', plan))
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


class OnEulerAngles(Model):
    """The same navigation with roll, pitch and yaw as states, of the biases as they are."""

    state = Space(
        (*'xyz', 'roll', 'pitch', 'yaw', *MODEL.state.names[6:]), MODEL.state.units,
        angles=('roll', 'pitch', 'yaw'),
    )  # fmt: skip
    input, max_step = MODEL.input, MODEL.max_step

    def __init__(self, same):
        self._same = same

    def rates(self, x):
        """Return the change of the angles by the angular rate of the body (..., 3, 3)."""
        roll, pitch = x[..., 3], x[..., 4]
        s, c, o = np.sin(roll), np.cos(roll), np.zeros_like(roll)
        columns = (
            (np.cos(pitch), o, o),
            (s * np.sin(pitch), c * np.cos(pitch), s),
            (c * np.sin(pitch), -s * np.cos(pitch), c),
        )
        return np.moveaxis(np.array(columns) / np.cos(pitch), (0, 1), (-1, -2))

    def derivative(self, x, u):
        rotation = so3.from_euler(x[..., 3:6])
        there = np.concatenate((x[..., :3], rotation, x[..., 6:]), axis=-1)
        found = self._same.derivative(there, u)
        rate = u[..., :3] - x[..., 9:12]
        found[..., 3:6] = (self.rates(x) @ rate[..., np.newaxis])[..., 0]
        return found

    def noise_density(self, x):
        W, E = self._same.noise_density(x).copy(), self.rates(x)
        W[3:6, 3:6] = E @ W[3:6, 3:6] @ E.T
        return W


def test_on_euler_angles_it_is_the_same_motion():
    """The plain filter below is of the same plant, in other coordinates."""
    rng = np.random.default_rng(3)
    x, u = rng.normal(size=15), rng.normal(size=6)
    angles = x.copy()
    angles[3:6] = so3.to_euler(x[3:6])
    moved, expected = OnEulerAngles(MODEL).step(angles, u, 0.01), MODEL.step(x, u, 0.01)
    moved[3:6] = so3.from_euler(moved[3:6])
    np.testing.assert_allclose(SPACE.subtract(moved, expected), 0.0, atol=1e-7)


@pytest.mark.thorough
@pytest.mark.slow
def test_hypotheses_find_a_heading_that_is_wrong_by_a_right_angle():
    """One Gaussian, of an extended filter, is about a heading that it cannot be linear in.

    `heading_survey` is the same for 200 drives of the hypotheses.
    """
    low, high = survey.band(20)
    driven = survey.drives(200)
    found, headings = survey.scores('gaussian_sum', driven.of(slice(0, 20)))
    assert low < found.mean() < high
    assert headings.max() < 0.6
    assert survey.scores('ekf', driven)[0].mean() > 1.5
    # plain, on Euler angles
    found, headings = survey.scores('ekf', driven, OnEulerAngles(survey.MODEL))
    assert found.mean() > 3.0
    assert headings.max() > 1.0
