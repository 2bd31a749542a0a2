# SPDX-License-Identifier: Apache-2.0
"""Published designs, to the digits given."""

import numpy as np
import pytest

from kalman_ros.control.lqe import dlqe, lqe
from kalman_ros.control.lqr import cost, dlqr, lqr
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
