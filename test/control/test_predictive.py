# SPDX-License-Identifier: Apache-2.0
"""Predictive control: the regulator without limits, and the dense program with them."""

import numpy as np
import pytest
from scipy.optimize import minimize

from kalman_ros.control import predictive
from kalman_ros.control.feedback import Feedback, Regulator
from kalman_ros.control.limiter import limits_of
from kalman_ros.control.lqr import Cost, cost, dlqr
from kalman_ros.control.motion import Differences, Motion
from kalman_ros.control.predictive import Predictor, predicted, stretches
from kalman_ros.core import Space

INF = np.inf
F, G = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
PRICE = Cost(np.diag([1.0, 0.1]), np.array([[0.1]]), np.zeros((2, 1)))
SPACE = Space(('x', 'v'), ('m', 'm/s'))
REST = Motion(SPACE, 0.1, np.zeros((1, 2)), np.zeros((1, 1)))


def prediction(limits=None, steps=12, moves=12, price=1e6, plant=(F, G), cost_=PRICE):
    design = dlqr(*plant, cost_)
    n = len(plant[0])
    none = np.full(n, -INF), np.full(n, INF)
    return predicted(
        plant, cost_, design, 0.1, horizon=0.1 * steps, moves=moves, price_of_states=price / 0.1,
        limits=limits or none,
    )  # fmt: skip


def input_limits(most=INF, rate=INF, m=1):
    return limits_of(m, {'input_limit': most, 'input_rate_limit': rate})


def test_stretches_begin_short_and_fill_the_horizon():
    for steps in (1, 2, 7, 84, 200, 2000):
        for moves in (1, 2, 20, 200):
            lengths = stretches(steps, moves)
            assert lengths.sum() == steps and len(lengths) == min(moves, steps)
            assert (np.diff(lengths[:-1]) >= 0).all() and lengths.min() >= 1
    assert stretches(84, 20)[0] == 1


def test_without_a_limit_that_acts_it_adds_nothing():
    rng = np.random.default_rng(0)
    for seed in range(20):
        n, m = rng.integers(1, 6), rng.integers(1, 4)
        plant = rng.normal(size=(n, n)) * 0.7, rng.normal(size=(n, m))
        weights = cost(np.ones(n), np.ones(m), (n, m))
        free = Predictor(prediction(plant=plant, cost_=weights), input_limits(1e6, m=m))
        rest = Motion(Space(tuple(f'x{i}' for i in range(n)), ('',) * n), 0.1, np.zeros((1, n)),
                      np.zeros((1, m)))  # fmt: skip
        for x in rng.normal(size=(5, n)):
            assert not free.correction(x, rest, np.zeros(m)).any(), seed
        assert free.limited == 0


def dense(x, most, rate, low, high, before=0.0, steps=12, price=1e6):
    """Return the first input of the whole program in inputs and excess, by another solver."""
    design = dlqr(F, G, PRICE)

    def run(u):
        states = [x]
        for value in u:
            states.append(F @ states[-1] + G[:, 0] * value)
        return np.array(states)

    def total(u):
        states = run(u)
        excess = np.maximum(states[1:, 1] - high, 0.0) + np.maximum(low - states[1:, 1], 0.0)
        value = np.sum(states[:-1] ** 2 @ np.diag(PRICE.state)) + 0.1 * np.sum(u * u)
        return value + states[-1] @ design.cost_to_go @ states[-1] + price * np.sum(excess**2)

    limits = [{'type': 'ineq', 'fun': lambda u: rate * 0.1 - np.abs(np.diff(u, prepend=before))}]
    found = minimize(
        total, np.clip(-(run(np.zeros(steps))[:-1] @ design.gain[0]), -most, most),
        method='SLSQP', bounds=[(-most, most)] * steps, constraints=limits if rate < INF else (),
        options={'ftol': 1e-14, 'maxiter': 1000},
    )  # fmt: skip
    return found.x


@pytest.mark.parametrize('x', [[1.0, 0.0], [2.0, 0.3], [-1.0, -0.5], [0.3, 1.0]])
def test_with_limits_it_is_the_whole_program(x):
    x = np.array(x)
    limits = np.array([-INF, -0.4]), np.array([INF, 0.4])
    control = Predictor(prediction(limits, price=50.0), input_limits(1.0))
    u = -dlqr(F, G, PRICE).gain @ x + control.correction(x, REST, np.zeros(1))
    expected = dense(x, 1.0, INF, -0.4, 0.4, price=50.0)
    assert control.limited == 1
    np.testing.assert_allclose(u, expected[0], atol=2e-5)
    states, inputs = control.plan(x, REST)
    np.testing.assert_allclose(inputs[:, 0], expected, atol=5e-4)
    np.testing.assert_allclose(states[0], x)


@pytest.mark.slow
def test_a_limit_of_the_rate_counts_from_the_last_input():
    x = np.array([1.0, 0.0])
    K = dlqr(F, G, PRICE).gain
    for before in (-1.0, 0.0, 0.7):
        control = Predictor(prediction(), input_limits(2.0, 3.0))
        u = -K @ x + control.correction(x, REST, np.array([before]))
        expected = dense(x, 2.0, 3.0, -INF, INF, before)
        np.testing.assert_allclose(u, expected[0], atol=1e-4)
        assert np.abs(u - before) <= 0.3 + 1e-9


@pytest.mark.slow
def test_the_input_of_now_is_within_its_limits_whatever_the_state():
    rng = np.random.default_rng(1)
    limits = np.array([-1.0, -0.4]), np.array([1.0, 0.4])
    control = Predictor(prediction(limits, 100, 10), input_limits(0.5, 2.0))
    K, u = dlqr(F, G, PRICE).gain, np.zeros(1)
    for x in rng.normal(size=(200, 2)) * 10.0 ** rng.uniform(-3, 1, (200, 1)):
        before, u = u, -K @ x + control.correction(x, REST, u)
        rounding = 1e-7 * max(1.0, float(np.abs(K @ x)[0]))
        assert np.abs(u) <= 0.5 + rounding and np.abs(u - before) <= 0.2 + rounding
        u = np.clip(u, -0.5, 0.5)


def closed_loop(control, x, steps, most):
    K, u, states, total = dlqr(F, G, PRICE).gain, np.zeros(1), [x], 0.0
    for _ in range(steps):
        u = -K @ x if control is None else -K @ x + control.correction(x, REST, u)
        u = np.clip(u, -most, most)
        total += x @ PRICE.state @ x + u @ PRICE.input @ u
        x = F @ x + G @ u
        states.append(x)
    return np.array(states), total


@pytest.mark.slow
def test_from_any_state_the_correction_is_finite():
    limits = np.array([-1.0, -0.4]), np.array([1.0, 0.4])
    control = Predictor(prediction(limits, 100, 10), input_limits(0.5, 2.0))
    for power in range(-300, 300, 60):
        x = np.array([1.0, -1.0]) * 10.0**power
        assert np.isfinite(control.correction(x, REST, np.zeros(1))).all(), power


@pytest.mark.slow
def test_it_costs_less_than_a_regulator_that_is_cut_off():
    rng = np.random.default_rng(2)
    for x in rng.uniform(-3.0, 3.0, (8, 2)):
        control = Predictor(prediction(steps=60, moves=20), input_limits(0.3))
        planned, clipped = (closed_loop(c, x, 300, 0.3)[1] for c in (control, None))
        assert planned <= clipped * (1.0 + 1e-6)


@pytest.mark.slow
def test_a_state_stays_within_its_limit_at_its_price():
    x, limits = np.array([5.0, 0.0]), (np.array([-INF, -0.4]), np.array([INF, 0.4]))
    for price, excess in ((1e6, 1e-4), (1e3, 0.05)):
        control = Predictor(prediction(limits, 60, 20, price), input_limits(2.0))
        states, _ = closed_loop(control, x, 300, 2.0)
        assert -0.4 - excess < states[:, 1].min() < -0.4 + 1e-6
        assert np.abs(states[-1]).max() < 1e-3
    free, _ = closed_loop(None, x, 300, 2.0)
    assert free[:, 1].min() < -1.0


def test_a_limit_that_has_to_be_kept_and_cannot_is_counted_and_the_input_goes_on():
    limits = np.array([-INF, -0.4]), np.array([INF, 0.4])
    control = Predictor(prediction(limits, price=INF), input_limits(1.0))
    inside = np.array([0.6, -0.3])
    assert np.isfinite(control.correction(inside, REST, np.zeros(1))).all()
    assert control.infeasible == 0
    assert np.isfinite(control.correction(np.array([0.0, 9.0]), REST, np.zeros(1))).all()
    assert control.infeasible == 1


def test_where_there_is_no_time_the_last_plan_goes_on():
    control = Predictor(prediction(), input_limits(0.5))
    x = np.array([2.0, 0.0])
    control.correction(x, REST, np.zeros(1))
    _, inputs = control.plan(x, REST)
    x = F @ x + G @ inputs[0]
    late = _never_in_time(control)
    u = -dlqr(F, G, PRICE).gain @ x + late(x)
    np.testing.assert_allclose(u, inputs[1], atol=1e-9)
    assert control.late == 1


def test_after_another_input_the_last_plan_does_not_go_on():
    design = dlqr(F, G, PRICE)
    feedback = Feedback(design.gain, np.empty((1, 0)), (), design.poles, prediction())
    x, rest = np.array([2.0, 0.0]), (np.zeros(2), np.zeros(1))
    regulator = Regulator(SPACE, feedback, rest, limits=input_limits(0.5))
    regulator.propose(x, 0.1)
    regulator.follow(x, np.zeros(1))
    _never_in_time(regulator.predictor)
    np.testing.assert_allclose(regulator.propose(x, 0.1), -design.gain @ x)


def _never_in_time(control):
    def solve(*_):
        raise predictive.LateError('late')

    control._steady.problem.solve = solve
    return lambda x: control.correction(x, REST, np.zeros(1))


def test_several_loops_are_as_one_each():
    control = Predictor(prediction(), input_limits(0.5))
    x = np.array([[2.0, 0.0], [0.01, 0.0], [-1.0, 0.5]])
    together = control.correction(x, REST, np.zeros((3, 1)))
    for row, one in zip(x, together):
        alone = Predictor(prediction(), input_limits(0.5)).correction(row, REST, np.zeros(1))
        np.testing.assert_array_equal(alone, one)
    assert together.shape == (3, 1) and not together[1].any()


def test_along_a_motion_of_constant_steps_it_is_that_of_the_law():
    design, N = dlqr(F, G, PRICE), 12
    W = PRICE.input + G.T @ design.cost_to_go @ G
    rows = [np.broadcast_to(part, (N + 1, *part.shape)) for part in (F, G, W)]
    gains = np.broadcast_to(design.gain, (N + 1, 1, 2))
    moving = Motion(SPACE, 0.1, np.zeros((N + 1, 2)), np.zeros((N + 1, 1)), gains,
                    Differences(*rows))  # fmt: skip
    x = np.array([2.0, 0.0])
    found, expected = (
        Predictor(prediction(), input_limits(0.5)).correction(x, ahead, np.zeros(1))
        for ahead in (moving, REST)
    )
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_limits_are_those_of_the_input_and_not_of_its_difference_from_the_reference():
    held = Motion(SPACE, 0.1, np.zeros((1, 2)), np.full((1, 1), 0.4))
    x = np.array([1.0, 0.0])
    for sign in (1.0, -1.0):
        control = Predictor(prediction(), input_limits(0.5))
        add = control.correction(sign * x, held, np.zeros(1))
        u = 0.4 - dlqr(F, G, PRICE).gain @ (sign * x) + add
        np.testing.assert_allclose(u, -sign * 0.5, atol=1e-6)


def test_the_regulator_adds_the_correction_and_waits_for_nothing_at_rest():
    design = dlqr(F, G, PRICE)
    feedback = Feedback(design.gain, np.empty((1, 0)), (), design.poles, prediction())
    rest = np.zeros(2), np.zeros(1)
    regulator = Regulator(SPACE, feedback, rest, limits=input_limits(0.5))
    u = regulator.propose(np.array([2.0, 0.0]), 0.1)
    np.testing.assert_allclose(u, [-0.5], atol=1e-6)
    regulator.adopt(feedback, 0.0, input_limits(0.25))
    np.testing.assert_allclose(regulator.propose(np.array([2.0, 0.0]), 0.1), [-0.25], atol=1e-6)
    still = Feedback(0.0 * design.gain, np.empty((1, 0)), (), design.poles, prediction())
    assert not Regulator(SPACE, still, rest, limits=input_limits(0.5)).propose(
        np.array([2.0, 0.0]), 0.1).any()  # fmt: skip
