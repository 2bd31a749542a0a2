# SPDX-License-Identifier: Apache-2.0
"""Motions of models: against a dense solution, the flatness of the unicycle, and themselves."""

import numpy as np
import pytest
from thorough import mostly_thorough

from kalman_ros.control import planning
from kalman_ros.control.lqr import Cost, cost, dlqr, sampled_cost
from kalman_ros.control.motion import Motion
from kalman_ros.control.planning import ReferenceMotion, fit
from kalman_ros.control.time_varying import (
    Linearization,
    backward_riccati,
    cost_along,
    linearized_along,
    resting_regulator,
    with_gains,
)
from kalman_ros.core import DesignError, LinearSystem, OperatingPoint, Space, linearize
from kalman_ros.models.cart_pole import CartPole
from kalman_ros.models.diff_drive import diff_drive
from kalman_ros.models.submersible import Submersible

pytestmark = pytest.mark.slow

DT = 0.02
MASS = LinearSystem(
    [[0.0, 1.0], [-2.0, -0.3]], [[0.0], [1.0]], np.zeros((2, 2)),
    Space(('x', 'v'), ('m', 'm/s')), Space(('f',), ('N',)),
)  # fmt: skip
ROBOT = diff_drive(command_time=0.2)


def closed(model, motion):
    """Return by how much the steps of a motion miss the next states, the last one left out."""
    reached = model.step(motion.states[:-1], motion.inputs[:-1], motion.dt)
    return np.abs(model.state.subtract(reached, motion.states[1:]))[:-1].max()


def test_a_linear_motion_is_the_dense_least_squares_solution(monkeypatch):
    monkeypatch.setattr(planning, '_FIRST', 1e6)
    N = 40
    weights = cost([3.0, 1.0], [0.5], (2, 1))
    values = np.sin(np.linspace(0.0, 3.0, N + 1))[:, np.newaxis]
    motion = fit(MASS, ReferenceMotion(DT, (0,), values, {}), weights)
    step = MASS.sampled(DT)
    # x_k as a linear function of (x_0, u_0, ..., u_{N-1})
    rows, state = [], np.hstack((np.eye(2), np.zeros((2, N))))
    for k in range(N + 1):
        rows.append(state[0])
        if k < N:
            state = step.F @ state
            state[:, 2 + k] += step.G[:, 0]
    A = np.vstack((
        np.sqrt(3e6) * np.array(rows),
        np.hstack((np.zeros((N, 2)), np.sqrt(0.5) * np.eye(N))),
    ))  # fmt: skip
    z = np.linalg.lstsq(A, np.append(np.sqrt(3e6) * values[:, 0], np.zeros(N)), rcond=None)[0]
    np.testing.assert_allclose(motion.states[0], z[:2], atol=1e-7)
    np.testing.assert_allclose(motion.inputs[:-1, 0], z[2:], atol=1e-6)
    assert closed(MASS, motion) < 1e-10


def test_a_circle_of_the_unicycle_is_that_of_its_flat_outputs():
    """v = |p'|, omega = the rate of its direction; commands lead by 0.2 s times their rates."""
    t = np.arange(0.0, 12.0, 0.01)
    angle = 0.2 * t + 0.1 * np.sin(t)
    rate, bend = 0.2 + 0.1 * np.cos(t), -0.1 * np.sin(t)
    values = 2.0 * np.c_[np.sin(angle), 1.0 - np.cos(angle)]
    reference = ReferenceMotion(0.01, (0, 1), values, {3: angle})
    motion = fit(ROBOT, reference, cost([1.0] * 5, [1.0] * 2, (5, 2)))
    inner = slice(200, -200)
    np.testing.assert_allclose(motion.states[inner, 2], 2.0 * rate[inner], atol=5e-3)
    np.testing.assert_allclose(motion.states[inner, 4], rate[inner], atol=5e-3)
    commands = np.c_[2.0 * (rate + 0.2 * bend), rate + 0.2 * bend]
    np.testing.assert_allclose(motion.inputs[inner], commands[inner], atol=2e-2)
    assert closed(ROBOT, motion) < 1e-9
    assert np.abs(motion.states[inner, :2] - values[inner]).max() < 1e-5


@pytest.mark.parametrize('start', mostly_thorough([0.0, np.pi, -3.0], -3.0))
def test_headings_beyond_half_a_turn_are_no_difficulty(start):
    angle = np.linspace(0.0, 4.0 * np.pi, 1501)
    values = np.c_[np.sin(angle), 1.0 - np.cos(angle)]
    turn = np.array([[np.cos(start), -np.sin(start)], [np.sin(start), np.cos(start)]])
    reference = ReferenceMotion(0.02, (0, 1), values @ turn.T, {3: angle + start})
    motion = fit(ROBOT, reference, cost([1.0] * 5, [1.0] * 2, (5, 2)))
    assert np.abs(motion.states[:, :2] - reference.values).max() < 1e-3
    assert np.abs(motion.states[:, 3]).max() <= np.pi


def test_an_underactuated_model_leans_before_it_goes():
    model = CartPole()
    t = np.arange(0.0, 4.0, 0.01)
    s = t / t[-1]
    x = (0.5 * s**3 * (10.0 - 15.0 * s + 6.0 * s * s))[:, np.newaxis]
    ends = np.zeros(4), OperatingPoint(np.array([0.5, 0.0, 0.0, 0.0]), np.zeros(1))
    motion = fit(model, ReferenceMotion(0.01, (0,), x, {}, *ends),
                 cost([1.0] * 4, [1.0], (4, 1)))  # fmt: skip
    assert np.abs(motion.states[:, 0] - x[:, 0]).max() < 8e-3
    np.testing.assert_array_equal(motion.states[-1], [0.5, 0.0, 0.0, 0.0])
    assert np.abs(motion.states[0, 1:]).max() < 0.05
    assert closed(model, motion) < 1e-9


def test_an_end_that_is_not_reached_is_named():
    x = np.zeros((101, 1))
    end = OperatingPoint(np.array([0.0, 0.0, 0.3, 0.0]), np.zeros(1))
    walled = ReferenceMotion(0.01, (0,), x, {}, None, end)
    weights = cost([1e6, 1.0, 1e-6, 1e-6], [1.0], (4, 1))
    with pytest.raises(ValueError, match=r'it does not end where it should: \w+ is '):
        fit(CartPole(), walled, weights)


def test_what_cannot_be_reached_fails_with_state_and_time():
    class Broken(CartPole):
        def derivative(self, x, u):
            return np.where(np.abs(x[..., :1]) > 0.3, np.nan, super().derivative(x, u))

    x = np.linspace(0.0, 1.0, 101)[:, np.newaxis]
    with pytest.raises(ValueError, match=r'it fails at \w+, 0\.\d+ s'):
        fit(Broken(), ReferenceMotion(0.01, (0,), x, {}), cost([1.0] * 4, [1.0], (4, 1)))


def test_the_gains_are_those_of_the_dense_problem():
    rng = np.random.default_rng(3)
    N, n, m = 12, 3, 2
    F = rng.normal(size=(N, n, n))
    G = rng.normal(size=(N, n, m))
    Q = np.array([a @ a.T for a in rng.normal(size=(N, n, n))])
    R = np.array([np.eye(m) + a @ a.T for a in rng.normal(size=(N, m, m))])
    S = np.diag([1.0, 2.0, 3.0])
    weights = Cost(Q, R, np.zeros((N, n, m)))
    K, W, S_0 = backward_riccati(Linearization(F, G), weights, S)
    np.testing.assert_allclose(W[-1], R[-1] + G[-1].T @ S @ G[-1])
    x0 = rng.normal(size=n)
    # the whole cost as a quadratic function of all inputs
    free, forced = np.eye(n), np.zeros((n, N * m))
    H, g, c = np.zeros((N * m, N * m)), np.zeros(N * m), 0.0
    for k in range(N):
        H += forced.T @ Q[k] @ forced
        g += forced.T @ Q[k] @ free @ x0
        c += x0 @ free.T @ Q[k] @ free @ x0
        H[k * m : (k + 1) * m, k * m : (k + 1) * m] += R[k]
        free, forced = F[k] @ free, F[k] @ forced
        forced[:, k * m : (k + 1) * m] += G[k]
    H += forced.T @ S @ forced
    g += forced.T @ S @ free @ x0
    c += x0 @ free.T @ S @ free @ x0
    u = np.linalg.solve(H, -g)
    np.testing.assert_allclose(-K[0] @ x0, u[:m], rtol=1e-9)
    assert x0 @ S_0 @ x0 == pytest.approx(c + g @ u, rel=1e-9)


def test_at_rest_the_gains_are_those_of_the_steady_regulator():
    model = CartPole()
    weights = cost([1.0, 1.0, 10.0, 1.0], [0.1], (4, 1))
    rest = Motion(model.state, DT, np.zeros((80, 4)), np.zeros((80, 1)))
    found = with_gains(model, rest, weights)
    system = linearize(model, *model.equilibrium)
    step = system.sampled(DT)
    K = dlqr(step.F, step.G, sampled_cost(system, weights, DT)).gain
    np.testing.assert_allclose(found.gains, np.tile(K, (80, 1, 1)), rtol=1e-6, atol=1e-6)


def test_linearised_steps_and_costs_are_those_of_each_state():
    model = Submersible()
    rng = np.random.default_rng(1)
    x, u = rng.normal(size=(7, 6)), rng.normal(size=(7, 3))
    weights = cost([1.0] * 6, [1.0] * 3, (6, 3))
    F, G = linearized_along(model, x, u, 0.01)
    costs = cost_along(model, x, u, weights, 0.01)
    for k in range(7):
        system = linearize(model, x[k], u[k])
        expected = sampled_cost(system, weights, 0.01)
        np.testing.assert_allclose(costs.state[k], expected.state, atol=1e-12)
        np.testing.assert_allclose(costs.input[k], expected.input, atol=1e-12)
        np.testing.assert_allclose(costs.cross[k], expected.cross, atol=1e-12)
        step = system.sampled(0.01)
        np.testing.assert_allclose(F[k], step.F, atol=2e-3)
        np.testing.assert_allclose(G[k], step.G, atol=2e-4)


def test_what_no_input_moves_at_rest_is_left_as_it_is_unless_it_grows():
    system = linearize(ROBOT, *ROBOT.equilibrium)
    weights = cost([1.0] * 5, [1.0] * 2, (5, 2))
    step = system.sampled(0.01)
    rest = resting_regulator(step.F, step.G, sampled_cost(system, weights, 0.01), 0.01)
    assert not rest.gain[:, 1].any()
    assert rest.gain[0, 0] > 0.5 and rest.gain[1, 3] > 0.5
    growing = np.diag([1.02, 0.9])
    weights = Cost(np.eye(2), np.eye(1), np.zeros((2, 1)))
    with pytest.raises(DesignError, match=r'grows by 1\.02 a step'):
        resting_regulator(growing, np.array([[0.0], [1.0]]), weights, 0.01)
