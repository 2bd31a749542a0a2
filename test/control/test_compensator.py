# SPDX-License-Identifier: Apache-2.0
"""The LQG controller as a system: its poles around the plant, and what the loop costs."""

import numpy as np
import pytest

from kalman_ros.control.compensator import compensator, current_compensator
from kalman_ros.control.lqe import dlqe, lqe
from kalman_ros.control.lqr import cost, dlqr, lqr
from kalman_ros.control.performance import stationary_cost
from kalman_ros.control.separation import LqgLoop, optimal_cost
from kalman_ros.control.state_space import StateSpace, state_space, static
from kalman_ros.core import DesignError, Transition
from kalman_ros.linear.periodic import Readings
from kalman_ros.linear.placement import place, place_observer

W, V = np.diag([0.3, 0.1, 0.2]), np.diag([0.2, 0.5])


def near(found, wanted, tolerance=1e-6):
    np.testing.assert_allclose(
        np.sort_complex(found), np.sort_complex(wanted), rtol=tolerance, atol=tolerance
    )


def loop_poles(plant, controller):
    """Poles of the loop, from the loop L = H G and u = -L u."""
    return (controller @ plant).closed().poles


def random_plant(seed, dt=None, m=2, D=False):
    rng = np.random.default_rng(seed)
    return state_space(
        rng.normal(size=(3, 3)) * (0.7 if dt else 1.0),
        rng.normal(size=(3, m)),
        rng.normal(size=(2, 3)),
        rng.normal(size=(2, m)) if D else None,
        dt,
    )


def weights(m=2, cross=False):
    N = 0.04 * np.arange(3 * m).reshape(3, m) if cross else None
    return cost([1, 2, 0.5], [0.5] * m, (3, m), N)


@pytest.mark.parametrize('D', [False, True])
@pytest.mark.parametrize('seed', range(5))
def test_poles_are_those_of_regulator_and_estimator_continuous(seed, D):
    plant = random_plant(seed, D=D)
    regulator = lqr(plant.A, plant.B, weights())
    estimator = lqe(plant.A, plant.C, W, V)
    controller = compensator(plant, regulator.gain, estimator.gain)
    near(loop_poles(plant, controller), [*regulator.poles, *estimator.poles])


@pytest.mark.parametrize('cross', [None, np.array([[0.1, 0.0], [0.05, 0.1], [0.0, -0.1]])])
@pytest.mark.parametrize('seed', range(5))
def test_poles_are_those_of_regulator_and_estimator_sampled(seed, cross):
    plant = random_plant(seed, dt=0.1)
    regulator = dlqr(plant.A, plant.B, weights())
    estimator = dlqe(plant.A, plant.C, W, V, cross)
    expected = [*regulator.poles, *estimator.poles]
    predicting = compensator(plant, regulator.gain, estimator.predictor_gain)
    current = current_compensator(plant, static(regulator.gain, plant.dt), estimator)
    near(loop_poles(plant, predicting), expected)
    near(loop_poles(plant, current), expected)
    assert not np.any(predicting.D) and np.any(current.D)


@pytest.mark.parametrize('seed', range(5))
def test_the_controllers_do_what_their_equations_say(seed):
    plant = random_plant(seed, dt=0.1)
    F, G, C = plant.A, plant.B, plant.C
    K, estimator = dlqr(F, G, weights()).gain, dlqe(F, C, W, V)
    H = current_compensator(plant, static(K, plant.dt), estimator)
    rng = np.random.default_rng(seed)
    ahead, state = np.zeros(3), np.zeros(3)
    for y in rng.normal(size=(20, 2)):
        now = ahead + estimator.gain @ (y - C @ ahead)
        u = -K @ now
        np.testing.assert_allclose(-(H.C @ state + H.D @ y), u, atol=1e-10)
        ahead, state = F @ now + G @ u, H.A @ state + H.B @ y


@pytest.mark.parametrize('seed', range(5))
def test_the_cost_of_lqg_is_the_known_optimum_continuous(seed):
    plant = random_plant(seed)
    cross = weights(cross=True)
    regulator, estimator = lqr(plant.A, plant.B, cross), lqe(plant.A, plant.C, W, V)
    S, P, K, L = regulator.cost_to_go, estimator.covariance, regulator.gain, estimator.gain
    # Anderson and Moore, section 8.2, in both of its forms
    one = np.trace(S @ W) + np.trace(P @ K.T @ cross.input @ K)
    other = np.trace(P @ cross.state) + np.trace(S @ L @ V @ L.T)
    found = stationary_cost(plant, compensator(plant, K, L), W, V, cross)
    np.testing.assert_allclose([found, other], one, rtol=1e-8)


@pytest.mark.parametrize('seed', range(5))
def test_the_cost_of_lqg_is_the_known_optimum_sampled(seed):
    plant = random_plant(seed, dt=0.1)
    F, G, C = plant.A, plant.B, plant.C
    regulator, estimator = dlqr(F, G, weights(cross=True)), dlqe(F, C, W, V)
    step = Transition(F, G, W)
    K, S = regulator.gain, regulator.cost_to_go
    for controller, errors in (
        (current_compensator(plant, static(K, plant.dt), estimator), estimator.covariance),
        (compensator(plant, K, estimator.predictor_gain), estimator.prior),
    ):
        expected = optimal_cost(step, K, S, weights(cross=True), errors[np.newaxis])
        found = stationary_cost(plant, controller, W, V, weights(cross=True))
        np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_the_cost_of_a_regulator_of_ones_own_is_that_of_the_loop_in_theory():
    plant = random_plant(1, dt=0.1)
    F, G, C = plant.A, plant.B, plant.C
    K = place(F, G, [0.5, 0.6, 0.7]).gain
    loop = LqgLoop(Transition(F, G, W), [Readings(C, V)], static(K, 0.1))
    expected = loop.average(loop.cost_weight(weights())[np.newaxis], 10)[0].mean
    controller = current_compensator(plant, static(K, plant.dt), dlqe(F, C, W, V))
    np.testing.assert_allclose(stationary_cost(plant, controller, W, V, weights()), expected)


def test_a_regulator_with_a_state_costs_the_same_either_way_and_has_its_poles():
    plant = random_plant(4, dt=0.1)
    F, G, C = plant.A, plant.B, plant.C
    # a leaky integral of the first state, which no equation of a static gain covers
    m = G.shape[1]
    rng = np.random.default_rng(4)
    K = place(F, G, [0.5, 0.6, 0.7]).gain
    one = StateSpace(
        np.array([[0.9]]), 0.1 * np.eye(1, 3), 0.05 * rng.normal(size=(m, 1)), K, plant.dt
    )
    estimator = dlqe(F, C, W, V)
    loop = LqgLoop(Transition(F, G, W), [Readings(C, V)], one)
    H = current_compensator(plant, one, estimator)
    found = stationary_cost(plant, H, W, V, weights())
    np.testing.assert_allclose(loop.mean_cost(weights()), found, rtol=1e-9)
    poles = np.concatenate((loop.regulator_poles, loop.estimator_poles))
    closed = (H @ plant).closed().poles
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(closed), atol=1e-8)


@pytest.mark.parametrize('dt', [None, 0.1])
def test_no_other_gains_cost_less(dt):
    plant = random_plant(2, dt=dt)
    A, B, C = plant.A, plant.B, plant.C
    regulate, estimate = (lqr, lqe) if dt is None else (dlqr, dlqe)
    K, L = regulate(A, B, weights()).gain, estimate(A, C, W, V).predictor_gain
    best = stationary_cost(plant, compensator(plant, K, L), W, V, weights())
    rng = np.random.default_rng(0)
    for _ in range(20):
        other = compensator(
            plant, K + 0.01 * rng.normal(size=K.shape), L + 0.01 * rng.normal(size=L.shape)
        )
        assert stationary_cost(plant, other, W, V, weights()) > best
    poles = np.array([-1.0, -1.5, -2.0]) if dt is None else np.array([0.2, 0.3, 0.4])
    placed = compensator(plant, place(A, B, poles).gain, place_observer(A, C, poles).gain)
    near(loop_poles(plant, placed), [*poles, *poles], 1e-4)
    assert stationary_cost(plant, placed, W, V, weights()) > best


def test_a_simulation_costs_as_much():
    plant = random_plant(3, dt=0.1)
    F, G, C = plant.A, plant.B, plant.C
    K = place(F, G, [0.5, 0.6, 0.7]).gain
    tuned = dlqe(F, C, 3.0 * W, V)  # for another noise
    H = current_compensator(plant, static(K, plant.dt), tuned)
    expected = stationary_cost(plant, H, W, V, weights())
    rng = np.random.default_rng(0)
    runs = 4000
    x, state, total = np.zeros((runs, 3)), np.zeros((runs, 3)), []
    for step in range(400):
        y = x @ C.T + rng.normal(size=(runs, 2)) @ np.sqrt(V)
        u = -(state @ H.C.T + y @ H.D.T)
        if step >= 200:
            z = np.hstack((x, u))
            total.append(np.einsum('ri,ij,rj->r', z, weights().weight, z).mean())
        state = state @ H.A.T + y @ H.B.T
        x = x @ F.T + u @ G.T + rng.normal(size=(runs, 3)) @ np.sqrt(W)
    np.testing.assert_allclose(np.mean(total), expected, rtol=0.01)


def test_what_has_no_cost_says_why():
    plant = random_plant(0)
    K, L = lqr(plant.A, plant.B, weights()).gain, lqe(plant.A, plant.C, W, V).gain
    with pytest.raises(DesignError, match='the loop is not stable: it has poles at'):
        stationary_cost(plant, compensator(plant, -10.0 * K, L), W, V, weights())
    direct = state_space(np.eye(1), np.ones((1, 2)), np.ones((2, 1)), np.eye(2))
    with pytest.raises(DesignError, match='white noise straight on to the input'):
        stationary_cost(plant, direct, W, V, weights())
    with pytest.raises(ValueError, match='controller: expected 2 inputs'):
        stationary_cost(plant, random_plant(0, dt=0.1), W, V, weights())


def test_wrong_arguments_are_named():
    plant = random_plant(0)
    with pytest.raises(ValueError, match='regulator_gain: expected 2 x 3'):
        compensator(plant, np.eye(2), np.zeros((3, 2)))
    with pytest.raises(ValueError, match='observer_gain: expected 3 x 2'):
        compensator(plant, np.zeros((2, 3)), np.eye(3))
    with pytest.raises(ValueError, match='plant: expected a sampled one'):
        current_compensator(plant, static(np.zeros((2, 3)), plant.dt), lqe(plant.A, plant.C, W, V))
