# SPDX-License-Identifier: Apache-2.0
"""Published designs, to the digits given."""

import numpy as np
import pytest

from kalman_ros.control.compensator import compensator
from kalman_ros.control.lqe import dlqe, lqe
from kalman_ros.control.lqr import cost, dlqr, lqr
from kalman_ros.control.margins import margins
from kalman_ros.control.performance import stationary_cost
from kalman_ros.control.state_space import state_space
from kalman_ros.core import DesignError

ROOT3 = np.sqrt(3.0)


def design(A, B, Q, R, N=None):
    A, B = np.array(A, dtype=float), np.array(B, dtype=float)
    return lqr(A, B, cost(Q, R, B.shape, N))


def test_double_integrator():
    # Drake, systems/controllers/test/linear_quadratic_regulator_test.cc
    found = design([[0, 1], [0, 0]], [[0], [1]], [1, 1], [1])
    np.testing.assert_allclose(found.gain, [[1.0, ROOT3]], atol=1e-10)
    np.testing.assert_allclose(found.cost_to_go, [[ROOT3, 1.0], [1.0, ROOT3]], atol=1e-10)


def test_double_integrator_with_cross_weight():
    # Drake, the same file
    found = design([[0, 1], [0, 0]], [[0], [1]], [1, 1], [1], [1, 0])
    np.testing.assert_allclose(found.gain, [[1.0, 1.0]], atol=1e-10)
    np.testing.assert_allclose(found.cost_to_go, np.eye(2), atol=1e-10)


def test_discrete_double_integrator():
    # Drake, the same file
    found = dlqr(
        np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.0], [1.0]]), cost([1, 1], [1], (2, 1))
    )
    np.testing.assert_allclose(found.gain, [[0.422082440385453, 1.243928853903714]], atol=1e-12)


def test_matlab_lqr_page():
    # MathWorks, documentation of lqr
    found = design(
        [[0, 1, 0, 0], [0, -0.1, 3, 0], [0, 0, 0, 1], [0, -0.5, 30, 0]],
        [[0], [2], [0], [5]],
        [1, 0, 1, 0],
        [1],
    )
    np.testing.assert_allclose(found.gain, [[-1.0, -1.7559, 16.9145, 3.2274]], atol=5e-5)


def michigan_cart_pole():
    M, m, b, inertia, g, length = 0.5, 0.2, 0.1, 0.006, 9.8, 0.3
    p = inertia * (M + m) + M * m * length**2
    A = np.array(
        [
            [0, 1, 0, 0],
            [0, -(inertia + m * length**2) * b / p, m**2 * g * length**2 / p, 0],
            [0, 0, 0, 1],
            [0, -m * length * b / p, m * g * length * (M + m) / p, 0],
        ]
    )
    return A, np.array([[0], [(inertia + m * length**2) / p], [0], [m * length / p]])


def test_michigan_cart_pole():
    # Control Tutorials for MATLAB and Simulink, University of Michigan, inverted pendulum
    A, B = michigan_cart_pole()
    poles = np.sort(np.linalg.eigvals(A).real)
    np.testing.assert_allclose(poles, [-5.6041, -0.1428, 0.0, 5.5651], atol=5e-5)
    found = design(A, B, [1, 0, 1, 0], [1])
    np.testing.assert_allclose(found.gain, [[-1.0, -1.6567, 18.6854, 3.4594]], atol=5e-5)


def test_scalar():
    found = design([[0]], [[1]], [10], [2])
    np.testing.assert_allclose(found.gain, [[np.sqrt(5.0)]])
    np.testing.assert_allclose(found.cost_to_go, [[np.sqrt(20.0)]])


def test_steady_state_kalman_filter_of_the_dual():
    # Drake, systems/estimators/test/kalman_filter_test.cc
    found = lqe(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]]), np.eye(2), np.eye(1))
    np.testing.assert_allclose(found.gain, [[ROOT3], [1.0]], atol=1e-10)


def test_steady_state_kalman_filter_of_altair():
    # Altair Compose, documentation of lqe
    found = lqe(
        np.array([[-1.0, 0.1], [0.0, -2.0]]), np.array([[1.0, 0.0]]), 0.1 * np.eye(2), np.eye(1)
    )
    np.testing.assert_allclose(found.gain, [[0.04889], [0.00082]], atol=5e-6)


@pytest.mark.parametrize('seed', range(20))
def test_regulator_and_estimator_are_dual(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(4, 2))
    root = rng.normal(size=(4, 4))
    Q, R = root @ root.T, np.diag(rng.uniform(0.5, 2.0, 2))
    regulator = lqr(A, B, cost(Q, R, (4, 2)))
    estimator = lqe(A.T, B.T, Q, R)
    np.testing.assert_allclose(estimator.gain, regulator.gain.T, rtol=1e-8)
    np.testing.assert_allclose(np.sort(estimator.poles), np.sort(regulator.poles), rtol=1e-6)


def test_discrete_estimator_is_a_fixed_point_of_the_filter():
    rng = np.random.default_rng(3)
    F, C = 0.5 * rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    Q, R = 0.1 * np.eye(3), np.diag([0.5, 1.0])
    found = dlqe(F, C, Q, R)
    prior = F @ found.covariance @ F.T + Q
    np.testing.assert_allclose(prior, found.prior, atol=1e-12)
    S = C @ prior @ C.T + R
    np.testing.assert_allclose(found.gain, prior @ C.T @ np.linalg.inv(S), atol=1e-12)


def test_what_no_input_can_stabilise_is_named():
    with pytest.raises(DesignError, match='no input can stabilise the modes at 2'):
        design([[2, 0], [0, -1]], [[0], [1]], [1, 1], [1])


def test_a_mode_on_the_boundary_without_weight_is_refused():
    with pytest.raises(DesignError, match='no weight'):
        design([[0, 1], [0, 0]], [[0], [1]], [0, 0], [1])


@pytest.mark.parametrize(
    ('Q', 'R', 'N', 'says'),
    [
        ([1, 1, 1], [1], None, 'state_cost: expected 2 numbers'),
        ([1, -1], [1], None, 'state_cost: expected a positive semi-definite'),
        ([1, 1], [0], None, 'input_cost: expected a positive definite'),
        ([1, 1], [1], [1, 2, 3], 'cross_cost: expected 2 x 1'),
        ([1, 1], [1], [5, 0], 'cross_cost with state_cost and input_cost'),
    ],
)
def test_wrong_weights_are_named(Q, R, N, says):
    with pytest.raises(ValueError, match=says):
        cost(Q, R, (2, 1), N)


def doyle(weight):
    """Return plant, LQR loop, LQG loop, noises and cost of Doyle's example with q = sigma."""
    A, B, C = [[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], [[1.0, 0.0]]
    plant, ones = state_space(A, B, C), weight * np.ones((2, 2))
    weights = cost(ones, [1], (2, 1))
    regulator, estimator = lqr(plant.A, plant.B, weights), lqe(plant.A, plant.C, ones, np.eye(1))
    controller = compensator(plant, regulator.gain, estimator.gain)
    price = stationary_cost(plant, controller, ones, np.eye(1), weights)
    return regulator, estimator, state_space(A, B, regulator.gain), controller @ plant, price


def test_doyle_has_no_guaranteed_margins():
    # J. Doyle, "Guaranteed margins for LQG regulators", IEEE Trans. Automatic Control 23(4), 1978
    regulator, estimator, lqr_loop, lqg_loop, price = doyle(1.0)
    f = 2.0 + np.sqrt(5.0)
    np.testing.assert_allclose(regulator.gain, [[f, f]], rtol=1e-9)
    np.testing.assert_allclose(estimator.gain, [[f], [f]], rtol=1e-9)
    np.testing.assert_allclose(price, 401.2461, atol=5e-5)
    found = margins(lqg_loop)
    np.testing.assert_allclose(found.lower_gain.value, 0.9209, atol=6e-5)  # .920844
    np.testing.assert_allclose(found.upper_gain.value, 1.05573, atol=5e-6)
    np.testing.assert_allclose(np.degrees(found.lead.value), 3.42, atol=5e-3)
    np.testing.assert_allclose(np.degrees(found.lag.value), 9.03, atol=5e-3)
    found = margins(lqr_loop)
    np.testing.assert_allclose(found.lower_gain.value, 0.47214, atol=5e-6)
    np.testing.assert_allclose(np.degrees(found.lag.value), 61.827, atol=5e-4)
    assert found.upper_gain.value == np.inf


@pytest.mark.parametrize('weight', [1.0, 5.0, 60.0])
def test_the_cost_and_the_upper_gain_of_doyle(weight):
    *_, lqg_loop, price = doyle(weight)
    f = 2.0 + np.sqrt(4.0 + weight)
    np.testing.assert_allclose(price, 5.0 * f * (weight + f * f), rtol=1e-8)
    np.testing.assert_allclose(margins(lqg_loop).upper_gain.value, 1.0 + 1.0 / f**2, rtol=1e-8)


def test_doyle_with_weight_five():
    *_, lqg_loop, price = doyle(5.0)
    np.testing.assert_allclose(price, 750.0, rtol=1e-9)
    np.testing.assert_allclose(margins(lqg_loop).upper_gain.value, 1.04, rtol=1e-9)
