# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from kalman_ros.core import LinearSystem, Space, van_loan, zero_order_hold
from kalman_ros.linear.discretize import Discretization, flow


@pytest.mark.parametrize('scale', [1e-6, 0.1, 1.0, 30.0])
@pytest.mark.parametrize('n', [1, 2, 5, 12])
def test_exponential_equals_scipy(n, scale):
    A = scale * np.random.default_rng(n).normal(size=(n, n))
    expected = expm(A)
    np.testing.assert_allclose(
        zero_order_hold(A, np.zeros((len(A), 0)), 1.0)[0],
        expected,
        atol=1e-11 * np.abs(expected).max(),
    )


def test_zero_order_hold_of_a_double_integrator():
    F, G = zero_order_hold(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), 0.5)
    np.testing.assert_allclose(F, [[1.0, 0.5], [0.0, 1.0]])
    np.testing.assert_allclose(G, [[0.125], [0.5]])


def test_van_loan_of_a_double_integrator():
    # white acceleration: Bar-Shalom, Li and Kirubarajan, equation 6.2.2-12
    T, q = 0.3, 2.0
    Q = van_loan(np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([0.0, q]), T)
    np.testing.assert_allclose(Q, q * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]))


def test_van_loan_equals_quadrature():
    rng = np.random.default_rng(1)
    A, root = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    W, dt = root @ root.T, 0.7
    nodes, weights = np.polynomial.legendre.leggauss(30)
    times, weights = 0.5 * dt * (nodes + 1.0), 0.5 * dt * weights
    expected = sum(w * expm(A * t) @ W @ expm(A * t).T for t, w in zip(times, weights))
    np.testing.assert_allclose(van_loan(A, W, dt), expected, rtol=1e-10)


def test_two_half_steps_are_one_step():
    system = LinearSystem(
        [[0.0, 1.0], [-2.0, -0.3]],
        [[0.0], [1.0]],
        np.diag([0.0, 0.4]),
        Space(('x', 'v'), ('m', 'm/s')),
        Space(('f',), ('N',)),
    )
    half, whole = system.sampled(0.05), system.sampled(0.1)
    np.testing.assert_allclose(half.F @ half.F, whole.F, atol=1e-14)
    np.testing.assert_allclose(half.F @ half.Q @ half.F.T + half.Q, whole.Q, atol=1e-15)
    np.testing.assert_allclose(half.F @ half.G + half.G, whole.G, atol=1e-14)


def test_a_step_of_no_length_changes_nothing():
    F, G = zero_order_hold(np.array([[-1.0]]), np.array([[2.0]]), 0.0)
    np.testing.assert_allclose(F, 1.0, rtol=1e-15)
    np.testing.assert_array_equal(G, 0.0)


@pytest.mark.parametrize('dt', [1e-6, 1e-3, 0.1, 3.0])
def test_noise_of_a_step_of_any_length_is_that_of_the_blocks_of_van_loan(dt):
    A, W = np.array([[0.0, 1.0], [-0.2, -0.5]]), np.diag([0.0, 0.3])
    block = expm(np.block([[-A, W], [np.zeros((2, 2)), A.T]]) * dt)
    expected = block[2:, 2:].T @ block[:2, 2:]
    np.testing.assert_allclose(van_loan(A, W, dt), expected, rtol=1e-10)


def test_the_noise_of_a_very_long_step_is_that_of_the_steady_state():
    A, W = np.array([[-5.0, 1.0], [0.0, -40.0]]), np.diag([0.1, 2.0])
    np.testing.assert_allclose(van_loan(A, W, 3600.0), solve_continuous_lyapunov(A, -W), rtol=1e-9)


def test_a_model_that_changes_infinitely_fast_has_no_step():
    A = np.array([[-1e308, 1e308], [1e308, -1e308]])
    with np.errstate(over='ignore'), pytest.raises(np.linalg.LinAlgError, match='infinite'):
        van_loan(A, np.eye(2), 1.0)


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('longest', [0.0, 1e-6, 0.003, 0.03, 0.1, 1.0])
@pytest.mark.parametrize('dt', [1e-6, 0.003, 0.03, 0.1, 1.0])
def test_the_terms_that_a_longest_step_needs_are_enough_for_every_step(longest, dt):
    rng = np.random.default_rng(0)
    A, B, root = rng.normal(size=(4, 4)), rng.normal(size=(4, 2)), rng.normal(size=(4, 4))
    W = root @ root.T
    short, whole = Discretization(A, B, W, longest), Discretization(A, B, W)
    assert short._table.shape[0] <= whole._table.shape[0]
    for found, expected in zip(short(dt), whole(dt)):
        # each halving doubles what rounding leaves
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())
        if dt <= longest:
            tight = 1e-15 * np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=tight)


def test_what_grows_beyond_all_numbers_within_a_step_is_an_error_and_no_matrix_of_nan():
    A = np.array([[800.0, 1.0], [0.0, 700.0]])
    for makes in (lambda: zero_order_hold(A, np.eye(2), 2.0), lambda: van_loan(A, np.eye(2), 2.0)):
        with pytest.raises(np.linalg.LinAlgError, match='grows beyond .* within a step of 2 s'):
            makes()
    assert zero_order_hold(-A, np.eye(2), 2.0)[0].max() == 0.0


@pytest.mark.parametrize('count', [1, 3, 200])
@pytest.mark.parametrize('dt', [0.0, 1e-3, 0.1, 5.0])
def test_steps_of_few_and_of_many_matrices_are_those_of_each(count, dt):
    rng = np.random.default_rng(count)
    A = rng.normal(size=(count, 4, 4))
    half = rng.normal(size=(count, 4, 4))
    W = half @ half.swapaxes(-1, -2)
    F, Q = flow(A, W, dt)
    for one, noise, f, q in zip(A[:9], W, F, Q):
        for found, expected in ((f, expm(one * dt)), (q, van_loan(one, noise, dt))):
            assert found == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())
    np.testing.assert_array_equal(Q, Q.swapaxes(-1, -2))


def test_few_matrices_with_a_small_square_need_few_terms():
    A = np.array([[[0.0, 30.0], [0.01, 0.0]], [[0.0, 1.0], [36.0, -0.1]]])
    W = np.array([[[0.0, 0.0], [0.0, 0.3]], [[0.2, 0.1], [0.1, 0.4]]])
    F, Q = flow(A, W, 0.01)
    for one, noise, f, q in zip(A, W, F, Q):
        expected = van_loan(one, noise, 0.01)
        np.testing.assert_allclose(f, expm(one * 0.01), rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(q, expected, rtol=0.0, atol=1e-15 * expected.max())


@pytest.mark.parametrize('spread', [0.0, 3.0, 8.0])
def test_the_units_of_the_states_cost_no_digits(spread):
    """A step of many halvings, since the norm of A is large while its poles are not."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        A, B, W = rng.normal(size=(4, 4)), rng.normal(size=(4, 1)), np.diag(rng.uniform(1, 2, 4))
        t = 10.0 ** rng.uniform(-spread, spread, 4)
        column, across = t[:, np.newaxis], np.outer(t, t)
        expected = Discretization(A, B, W)(0.5)
        F, G, Q = Discretization(A * column / t, B * column, W * across)(0.5)
        for found, exact in zip((F / column * t, G / column, Q / across), expected):
            np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-12 * np.abs(exact).max())


def test_a_mode_without_noise_that_grows_beyond_all_numbers_is_refused():
    with pytest.raises(np.linalg.LinAlgError, match='grows beyond all numbers within a step of 1'):
        flow(np.array([[800.0]]), np.zeros((1, 1)), 1.0)
    F, Q = flow(np.array([[700.0]]), np.zeros((1, 1)), 1.0)
    np.testing.assert_allclose([F.item(), Q.item()], [np.exp(700.0), 0.0])
