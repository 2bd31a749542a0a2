# SPDX-License-Identifier: Apache-2.0
"""Filters on states with rotations."""

import numpy as np
import pytest
from thorough import mostly_thorough

from kalman_ros.core import (
    Gaussian,
    LinearSystem,
    Model,
    Sensor,
    Space,
    TimedSensor,
    numerical_jacobian,
)
from kalman_ros.core import rotations as so3
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.batch_estimator import for_many
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.mixture import pooled, turned_parts
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.smoother import Filtered, smooth

TURN = Space(('rx', 'ry', 'rz', 'wx', 'wy', 'wz'), rotations=(('rx', 'ry', 'rz'),))


class Tumbling(Model):
    """R' = R [w]x with noise on both."""

    state, input, max_step = TURN, Space((), ()), 0.05

    def __init__(self, noise=1.0):
        self._noise = noise * np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3])

    def derivative(self, x, u):
        return np.concatenate((so3.rotate(x[..., :3], x[..., 3:]), np.zeros_like(x[..., 3:])), -1)

    def noise_density(self, x):
        return self._noise


class Attitude(Sensor):
    """The rotation itself, and what it makes of one direction."""

    def __init__(self, std):
        self.state = TURN
        self.output = Space(('rx', 'ry', 'rz', 'dx', 'dy', 'dz'), rotations=(('rx', 'ry', 'rz'),))
        self.covariance = std**2 * np.eye(6)

    def measure(self, x):
        r = x[..., :3]
        down = so3.rotate_back(r, np.array([0.0, 0.0, 1.0]))
        return np.concatenate((r, down), axis=-1)


MODEL = Tumbling()
START = np.array([2.0, -1.5, 1.0, 0.3, -0.5, 0.8])
NOTHING = np.zeros(0)


def plan_of(std, model=MODEL):
    return Plan(model, {'attitude': TimedSensor(Attitude(std), 10.0)}, 10.0)


def spread(size=0.1):
    root = size * np.random.default_rng(4).normal(size=(6, 6))
    return root @ root.T + 1e-6 * np.eye(6)


def test_a_step_is_the_turn_that_scipy_integrates():
    """A constant rate of the body gives the rotation of rate times time, applied first."""
    moved = MODEL.step(START, NOTHING, 2.0)
    expected = so3.compose(START[:3], 2.0 * START[3:])
    np.testing.assert_allclose(so3.exp(moved[:3]), so3.exp(expected), atol=1e-9)


def test_the_order_of_the_integrator_is_four():
    """With a rate in the world that turns, too, half the step has a sixteenth of the error."""

    class Nutating(Tumbling):
        def derivative(self, x, u):
            r, w = x[..., :3], x[..., 3:]
            return np.concatenate(
                (so3.rotate(r, w), np.cross(w, [[0.5, -1.0, 2.0]])[..., :][0]), -1
            )

    exact = Nutating()
    exact.max_step = 1e-3
    truth = exact.step(START, NOTHING, 0.8)
    errors = []
    for h in (0.2, 0.1):
        model = Nutating()
        model.max_step = h
        errors.append(np.linalg.norm(TURN.subtract(model.step(START, NOTHING, 0.8), truth)))
    assert 11.0 < errors[0] / errors[1] < 24.0


def test_jacobians_are_derivatives_on_the_group():
    at = [TURN.add(START, d) for d in 1e-6 * np.vstack((np.eye(6), -np.eye(6)))]
    moved = np.array([MODEL.step(x, NOTHING, 0.04) for x in at])
    F = (TURN.subtract(moved[:6], moved[6:]) / 2e-6).T
    np.testing.assert_allclose(MODEL.linearized_step(START, NOTHING, 0.04).F, F, atol=1e-6)
    sensor = Attitude(1.0)
    read = np.array([sensor.measure(x) for x in at])
    H = (sensor.output.subtract(read[:6], read[6:]) / 2e-6).T
    np.testing.assert_allclose(sensor.jacobian(START), H, atol=1e-8)
    np.testing.assert_allclose(H[:3, :3], np.eye(3), atol=1e-8)


def test_errors_move_by_the_jacobian_of_the_model():
    """A = d/dt of the difference of two states that are near."""
    A = MODEL.state_jacobian(START, NOTHING)
    dt = 1e-5
    F = numerical_jacobian(lambda x: MODEL.step(x, NOTHING, dt), START, TURN.subtract, TURN)
    np.testing.assert_allclose((F - np.eye(6)) / dt, A, atol=1e-4)


@pytest.mark.parametrize('kind', ['ekf', 'ukf', 'gaussian_sum'])
def test_filters_agree_where_the_noise_is_small(kind):
    small = 1e-3
    plan = plan_of(small, Tumbling(small**2))
    filter, peer = build_filter(kind, plan), build_filter('ekf', plan)
    sensor = plan.sensors['attitude'].sensor
    belief = other = Gaussian(START, spread(small))
    rng = np.random.default_rng(1)
    for _ in range(5):
        belief, other = (f.predict(b, NOTHING, 0.1) for f, b in ((filter, belief), (peer, other)))
        y = sensor.output.add(sensor.measure(other.mean), small * rng.normal(size=6))
        belief = filter.correct(belief, y, sensor).posterior
        other = peer.correct(other, y, sensor).posterior
    np.testing.assert_allclose(TURN.subtract(belief.mean, other.mean), 0.0, atol=2e-6)
    np.testing.assert_allclose(belief.covariance, other.covariance, rtol=2e-2, atol=1e-9)


@pytest.mark.parametrize('kind', ['ekf', 'ukf'])
def test_a_batch_is_as_one_by_one(kind):
    plan = plan_of(0.1)
    filter, sensor = build_filter(kind, plan), plan.sensors['attitude'].sensor
    many = for_many(filter)
    rng = np.random.default_rng(2)
    means = TURN.add(START, 0.5 * rng.normal(size=(7, 6)))
    y = sensor.output.add(sensor.measure(means), 0.3 * rng.normal(size=(7, 6)))
    P = np.broadcast_to(spread(), (7, 6, 6))
    together = many.predict(Gaussian(means, P), NOTHING, 0.2)
    corrected = many.correct(together, y, sensor).posterior
    for k in range(7):
        alone = filter.predict(Gaussian(means[k], P[k]), NOTHING, 0.2)
        one = filter.correct(alone, y[k], sensor).posterior
        np.testing.assert_allclose(corrected.mean[k], one.mean, atol=1e-9)
        np.testing.assert_allclose(corrected.covariance[k], one.covariance, atol=1e-9)


class Walk(Tumbling):
    """A rotation that only diffuses."""

    def derivative(self, x, u):
        return np.zeros_like(x)


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['ekf', 'ukf'])
def test_the_nees_of_a_rotation_walk_is_one(kind):
    runs, steps, dt, model = 400, 10, 0.2, Walk(0.3)
    rng = np.random.default_rng(5)
    plan = plan_of(0.2, model)
    filter, sensor = for_many(build_filter(kind, plan)), plan.sensors['attitude'].sensor
    P = 0.05 * np.eye(6)
    truth = TURN.add(np.tile(START, (runs, 1)), rng.multivariate_normal(np.zeros(6), P, runs))
    belief = Gaussian(np.tile(START, (runs, 1)), np.broadcast_to(P, (runs, 6, 6)))
    Q, found = dt * model.noise_density(START), []
    for _ in range(steps):
        truth = TURN.add(truth, rng.multivariate_normal(np.zeros(6), Q, runs))
        belief = filter.predict(belief, NOTHING, dt)
        noise = rng.multivariate_normal(np.zeros(6), sensor.covariance, runs)
        y = sensor.output.add(sensor.measure(truth), noise)
        belief = filter.correct(belief, y, sensor).posterior
        found.append(nees(TURN.subtract(truth, belief.mean), belief.covariance).mean() / 6.0)
    low, high = chi_square_bounds(1.0, 2.0 / (6 * runs), 0.001)
    assert low < np.mean(found) < high
    assert all(0.97 * low < each < 1.03 * high for each in found)


@pytest.mark.slow
@pytest.mark.parametrize('kind', mostly_thorough(['ekf', 'ukf'], 'ekf'))
def test_smoothed_rotations_are_nearer_and_consistent(kind):
    plan = plan_of(0.3, Tumbling(0.1))
    filter, sensor = build_filter(kind, plan), plan.sensors['attitude'].sensor
    rng = np.random.default_rng(6)
    before, after, scores = [], [], []
    for _ in range(12):
        truth = TURN.add(START, rng.multivariate_normal(np.zeros(6), spread()))
        belief, steps, truths = Gaussian(START, spread()), [], []
        for k in range(15):
            if k:
                step = plan.model.transition(truth, NOTHING, 0.1)
                truth = plan.model.step(truth, NOTHING, 0.1)
                truth = TURN.add(truth, rng.multivariate_normal(np.zeros(6), step.Q))
                belief = filter.predict(belief, NOTHING, 0.1)
            noise = 0.3 * rng.normal(size=6)
            belief = filter.correct(
                belief, sensor.output.add(sensor.measure(truth), noise), sensor
            ).posterior
            steps.append(Filtered(k * 10**8, belief, NOTHING))
            truths.append(truth)
        smoothed = smooth(filter, steps)
        for step, better, x in zip(steps, smoothed, truths):
            before.append(TURN.subtract(x, step.belief.mean))
            after.append(TURN.subtract(x, better.mean))
            scores.append(nees(after[-1], better.covariance) / 6.0)
    assert np.mean(np.square(after)) < 0.8 * np.mean(np.square(before))
    assert 0.75 < np.mean(scores) < 1.3


def test_parts_of_a_mixture_are_seen_from_their_mean():
    """Half of a turn apart, two parts scatter about the rotation between them."""
    space = Space(('rx', 'ry', 'rz'), rotations=(('rx', 'ry', 'rz'),))
    points = np.array([[0.0, 0.0, np.pi - 0.4], [0.0, 0.0, -np.pi + 0.4]])
    P = np.broadcast_to(0.01 * np.eye(3), (2, 3, 3))
    mean, total = pooled(space, np.array([0.5, 0.5]), points, P)
    assert np.linalg.norm(mean) == pytest.approx(np.pi)
    assert total[2, 2] == pytest.approx(0.01 + 0.4**2)
    turned = so3.inverse_left_jacobian(np.array([0.0, 0.0, 0.4]))[:2, :2]
    np.testing.assert_allclose(total[:2, :2], 0.01 * turned @ turned.T, atol=1e-12)


def test_a_linear_model_has_no_rotations():
    with pytest.raises(ValueError, match=r'state: expected no rotation in a linear model'):
        LinearSystem(np.zeros((6, 6)), np.zeros((6, 0)), np.eye(6), TURN, Space((), ()))


def test_a_rotation_that_is_too_wide_is_divided_into_the_same_belief():
    """The parts have the moments of the whole, which states beside the rotation follow."""
    P = np.diag([0.01, 0.02, 0.9, 0.1, 0.1, 0.1]) ** 2
    P[2, 5] = P[5, 2] = 0.05
    weights, parts = turned_parts(Gaussian(np.zeros(6), P), TURN, 8)
    assert len(parts) == 8
    assert all(part.std[:3].max() < 0.6 for part in parts)
    centres = np.array([part.mean for part in parts])
    np.testing.assert_allclose(weights @ centres, np.zeros(6), atol=1e-12)
    about = [part.covariance[2, 2] + part.mean[2] ** 2 for part in parts]
    assert weights @ about == pytest.approx(P[2, 2], rel=0.03)
    crossed = [part.covariance[2, 5] + part.mean[2] * part.mean[5] for part in parts]
    assert weights @ crossed == pytest.approx(P[2, 5], rel=0.03)


def test_an_angle_that_is_too_wide_is_divided_like_a_rotation():
    """A heading in the plane is the turn about one axis."""
    space = Space('x yaw wz', angles=('yaw',))
    P = np.diag([0.01, 0.9, 0.1]) ** 2
    P[1, 2] = P[2, 1] = 0.05
    turn = np.zeros((6, 6))
    turn[np.ix_([0, 2, 5], [0, 2, 5])] = P
    weights, parts = turned_parts(Gaussian(np.array([0.0, 3.0, 0.0]), P), space, 8)
    expected, turned = turned_parts(Gaussian(np.zeros(6), turn), TURN, 8)
    np.testing.assert_allclose(weights, expected)
    for part, other in zip(parts, turned):
        moved = space.subtract(part.mean, np.array([0.0, 3.0, 0.0]))
        np.testing.assert_allclose(moved, other.mean[[0, 2, 5]], atol=1e-12)
        assert abs(part.mean[1]) <= np.pi
        assert part.covariance[1, 1] == pytest.approx(other.covariance[2, 2])


def test_a_rotation_that_is_known_is_not_divided():
    belief = Gaussian(START, 0.25 * np.eye(6))
    weights, parts = turned_parts(belief, TURN, 8)
    assert weights.tolist() == [1.0]
    assert parts[0] is belief
    assert len(turned_parts(Gaussian(START, np.eye(6)), TURN, 1)[1]) == 1
