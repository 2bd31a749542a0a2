# SPDX-License-Identifier: Apache-2.0
"""Noises that belong together, and the estimate one step ahead."""

import numpy as np
import pytest

from kalman_ros.control.lqe import dlqe, lqe
from kalman_ros.core import DesignError

F, C = np.array([[0.9, 0.2], [-0.1, 0.8]]), np.array([[1.0, 0.5]])
Q, R, N = np.diag([0.3, 0.2]), np.array([[0.4]]), np.array([[0.2], [-0.1]])


def joint_filter(cross):
    """Return gains and covariances by conditioning (x, next x) on the reading, many times."""
    P = np.eye(2)
    for _ in range(500):
        S = C @ P @ C.T + R
        L, L_p = P @ C.T / S, (F @ P @ C.T + cross) / S
        after, P = P - L @ S @ L.T, F @ P @ F.T + Q - L_p @ S @ L_p.T
    return L, L_p, after, P


@pytest.mark.parametrize('cross', [0.0 * N, N])
def test_gains_are_where_the_filter_settles(cross):
    found = dlqe(F, C, Q, R, cross)
    parts = (found.gain, found.predictor_gain, found.covariance, found.prior)
    for part, expected in zip(parts, joint_filter(cross)):
        np.testing.assert_allclose(part, expected, atol=1e-10)
    np.testing.assert_allclose(found.poles, np.linalg.eigvals(F - found.predictor_gain @ C))


def test_independent_noises_predict_by_the_model_alone():
    found = dlqe(F, C, Q, R)
    np.testing.assert_allclose(found.predictor_gain, F @ found.gain, atol=1e-12)
    same = dlqe(F, C, Q, R, np.zeros((2, 1)))
    np.testing.assert_allclose(same.gain, found.gain)


def test_a_scalar_by_hand():
    # P of 2 a P + W = (P + N)^2 / V with a = 0, W = V = 1, N = 1/2: P = 1/2, L = 1
    found = lqe(np.zeros((1, 1)), np.eye(1), np.eye(1), np.eye(1), np.array([[0.5]]))
    np.testing.assert_allclose([found.covariance[0, 0], found.gain[0, 0]], [0.5, 1.0])


def test_fast_sampling_approaches_the_continuous_design():
    A, dt = np.array([[0.0, 1.0], [-2.0, -0.3]]), 1e-4
    slow = lqe(A, C, Q, R, N)
    fast = dlqe(np.eye(2) + A * dt, C, Q * dt, R / dt, N)
    np.testing.assert_allclose(fast.predictor_gain / dt, slow.gain, rtol=1e-3)
    np.testing.assert_allclose(fast.prior, slow.covariance, atol=1e-4)


def test_what_is_no_covariance_is_refused():
    with pytest.raises(ValueError, match='cross with the noises: expected a positive semi'):
        lqe(F, C, Q, R, 10.0 * N)
    with pytest.raises(ValueError, match='cross: expected 2 x 1'):
        dlqe(F, C, Q, R, np.zeros((2, 2)))


def test_the_scale_of_the_noise_does_not_matter():
    F, C = np.array([[1.1, 0.05], [0.2, 1.1]]), np.array([[1.0, 0.0]])
    Q, R = np.diag([1e-4, 1e-2]), np.array([[1e-2]])
    expected, found = dlqe(F, C, Q, R), dlqe(F, C, 1e-20 * Q, 1e-20 * R)
    np.testing.assert_allclose(found.gain, expected.gain, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, 1e-20 * expected.covariance, rtol=1e-9)
    A = np.array([[0.0, 1.0], [4.0, 0.0]])
    expected, found = lqe(A, C, Q, R), lqe(A, C, 1e-20 * Q, 1e-20 * R)
    np.testing.assert_allclose(found.gain, expected.gain, rtol=1e-9)


@pytest.mark.parametrize('design', [lqe, dlqe])
def test_what_no_reading_tells_of_is_named(design):
    A, C = np.diag([2.0, 0.5]), np.array([[0.0, 1.0]])
    with pytest.raises(DesignError, match='no reading observes the modes at 2'):
        design(A, C, np.eye(2), np.eye(1))


@pytest.mark.parametrize(('design', 'stays'), [(lqe, 0.0), (dlqe, 1.0)])
def test_a_constant_without_noise_is_refused(design, stays):
    A, C = np.diag([stays, -0.5]), np.array([[1.0, 1.0]])
    with pytest.raises(DesignError, match='has no process noise'):
        design(A, C, np.diag([0.0, 1.0]), np.eye(1))


@pytest.mark.filterwarnings('error')
def test_a_noise_whose_square_is_no_number_is_a_design_error():
    for design in (lqe, dlqe):
        with pytest.raises(DesignError, match='process noise whose squares are finite, got .*1e'):
            design(-0.5 * np.eye(2), np.eye(2), 1e200 * np.eye(2), np.eye(2))


def test_no_variance_of_what_is_known_exactly_is_below_zero():
    """Rounding leaves -2e-17 of a state without noise, and a root of that is no number."""
    A = np.array([[-6.0, 2, 0, 0], [0, -7, 0, 0], [0, 0, -6, 2], [0, 0, 0, -5]])
    found = lqe(A, np.array([[-2.0, 2, 0, 1]]), np.diag([100.0, 0, 0, 0]), np.eye(1))
    assert found.covariance.diagonal().min() >= 0.0
    assert np.linalg.eigvalsh(found.covariance).min() >= -1e-14 * found.covariance.max()
