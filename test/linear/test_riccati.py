# SPDX-License-Identifier: Apache-2.0
"""Riccati equations whose sizes are far apart: every digit, or an error that names the weight."""

import numpy as np
import pytest
from decimals import steady_filter
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import kalman_ros as kr
from kalman_ros.control.lqe import dlqe, lqe, sampled_lqe
from kalman_ros.control.lqr import Cost, cost, dlqr, lqr, sampled_lqr
from kalman_ros.core import DesignError, LinearSystem, Space
from kalman_ros.linear import riccati
from kalman_ros.linear.riccati import stein

TINY = [1e-2, 1e-6, 1e-10, 1e-16, 1e-20, 1e-26]


@pytest.mark.parametrize('R', TINY)
def test_the_covariance_of_a_scalar_filter_has_every_digit(R):
    """P = P R / (P + R) + 1; after the reading P R / (P + R), which P - L P loses."""
    found = dlqe(np.eye(1), np.eye(1), np.eye(1), np.array([[R]]))
    P = (1.0 + np.sqrt(1.0 + 4.0 * R)) / 2.0
    np.testing.assert_allclose(found.covariance, [[P * R / (P + R)]], rtol=1e-13)
    np.testing.assert_allclose((found.prior, found.gain), ([[P]], [[P / (P + R)]]), rtol=1e-13)


SYSTEMS = {
    'double integrator': ([[1, 0.1], [0, 1]], [[1, 0]], np.diag([1e-4, 1e-2])),
    'two readings of three': (
        [[1, 0.1, 0], [0, 1, 0.1], [0, 0, 1]], [[1, 0, 0], [0, 0, 1]], np.diag([1e-6, 1e-4, 1e-2]),
    ),
    'unstable': ([[1.2, 0.1], [0.3, 2.0]], [[1, 0]], np.diag([1e-4, 1e-2])),
}  # fmt: skip


@pytest.mark.parametrize('R', [1e6, 1.0, *TINY])
@pytest.mark.parametrize('name', SYSTEMS)
def test_gain_and_covariances_are_those_of_a_hundred_digits(name, R):
    F, C, Q = map(np.array, SYSTEMS[name])
    noise = R * np.eye(len(C))
    found = dlqe(F, C, Q, noise)
    prior, gain, after = steady_filter(F, C, Q, noise)
    np.testing.assert_allclose(found.gain, gain, rtol=1e-11, atol=1e-13 * np.abs(gain).max())
    for ours, exact in ((found.prior, prior), (found.covariance, after)):
        std = np.sqrt(exact.diagonal())
        assert np.abs(ours - exact).max() <= 1e-11 * np.abs(exact).max()
        np.testing.assert_allclose(np.sqrt(ours.diagonal()), std, rtol=1e-11)
        assert np.linalg.eigvalsh(ours / np.outer(std, std)).min() > -1e-14


WRONG = [
    np.zeros((2, 2)), np.ones((2, 2)), np.diag([1.0, -1.0]), np.diag([1.0, 1e-300]),
    np.diag([1.0, 1e300]), np.diag([1.0, np.nan]), np.diag([1e-320, 1.0]),
]  # fmt: skip


@pytest.mark.parametrize('R', WRONG, ids=str)
@pytest.mark.parametrize('design', [lqr, dlqr, lqe, dlqe])
def test_a_singular_or_absurd_weight_is_named(design, R):
    A, one = np.array([[0.0, 0.5], [-0.5, 0.1]]), np.eye(2)
    # in discrete time, the weight of the state is that of the input, too
    Q = one if design in (lqr, lqe) else np.zeros((2, 2))
    name = 'input_cost' if design in (lqr, dlqr) else 'noise of the readings'
    with pytest.raises(DesignError, match=f'^{name}: expected a positive definite matrix'):
        if design in (lqr, dlqr):
            design(A, one, Cost(Q, R, np.zeros((2, 2))))
        else:
            design(A, one, Q, R)


@pytest.mark.parametrize('R', [np.zeros((2, 2)), np.ones((2, 2)), np.diag([0.0, 1e-20])], ids=str)
def test_without_a_weight_of_its_own_an_input_has_that_of_the_state_after_it(R):
    # P. Benner, A. Laub, V. Mehrmann, A Collection of Benchmark Examples for Algebraic Riccati
    # Equations II (DAREX), 1995, example 1.1 has such an R
    F, G = np.array([[2.0, -1.0], [1.0, 0.0]]), np.array([[1.0, 0.3], [0.0, 2.0]])
    found = dlqr(F, G, Cost(np.eye(2), R, np.zeros((2, 2))))
    S, K = found.cost_to_go, found.gain
    np.testing.assert_allclose(K, np.linalg.solve(R + G.T @ S @ G, G.T @ S @ F), atol=1e-12)
    np.testing.assert_allclose(S, np.eye(2) + F.T @ S @ (F - G @ K), atol=1e-11)
    if not R.any():
        np.testing.assert_allclose(S, np.eye(2), atol=1e-12)
        np.testing.assert_allclose(G @ K, F, atol=1e-12)
    # the dual: a filter whose readings have no noise
    L = dlqe(F.T, G.T, np.eye(2), R).gain
    assert np.abs(np.linalg.eigvals(F.T @ (np.eye(2) - L @ G.T))).max() < 1.0


INTEGRATORS = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])


@pytest.mark.parametrize('R', [1e-60, 1e-40, 1e-30])
def test_a_size_that_cannot_be_weighed_is_named(R):
    with pytest.raises(DesignError, match='^input_cost: expected a size that can be weighed'):
        lqr(*INTEGRATORS, Cost(np.eye(2), np.array([[R]]), np.zeros((2, 1))))


@pytest.mark.parametrize('R', [1e-12, 1e20, 1e60])
def test_a_size_that_can_be_weighed_is_exact(R):
    found = lqr(*INTEGRATORS, Cost(np.eye(2), np.array([[R]]), np.zeros((2, 1))))
    k = R**-0.5
    np.testing.assert_allclose(found.gain, [[k, np.sqrt(2.0 * k + k**2)]], rtol=1e-7)


def test_units_do_not_matter():
    """Inputs in other units, twelve orders apart, and costs in others."""
    A, B = np.array([[0.0, 1.0], [2.0, -0.3]]), np.array([[0.0, 1.0], [1.0, 0.5]])
    units = np.array([1e-6, 1e6])
    for design in (lqr, dlqr):
        expected = design(A, B, cost([3, 1], [1, 2], (2, 2)))
        other = cost(1e-8 * np.array([3, 1]), 1e-8 * np.array([1, 2]) * units**2, (2, 2))
        found = design(A, B * units, other)
        np.testing.assert_allclose(found.gain * units[:, np.newaxis], expected.gain, rtol=1e-10)
        np.testing.assert_allclose(found.cost_to_go, 1e-8 * expected.cost_to_go, rtol=1e-10)


def test_a_sum_along_a_loop_is_the_series():
    A, W = np.array([[0.9, 0.5], [0.0, -0.8]]), np.diag([1.0, 1e-8])
    total, power = np.zeros((2, 2)), np.eye(2)
    for _ in range(2000):
        total, power = total + power.T @ W @ power, power @ A
    np.testing.assert_allclose(stein(A, W), total, rtol=1e-12)
    assert not stein(A, np.zeros((2, 2))).any()


sizes = st.tuples(st.integers(1, 5), st.integers(1, 3), st.integers(0, 10**6))


@pytest.mark.slow
@given(sizes, st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_filter_is_one_or_the_error_says_why(size, log_r, log_q):
    n, k, seed = size
    rng = np.random.default_rng(seed)
    F, C = rng.normal(size=(n, n)), rng.normal(size=(k, n))
    Q, R = 10.0**log_q * np.eye(n), 10.0**log_r * np.diag(10.0 ** rng.uniform(-3, 3, k))
    try:
        found = dlqe(F, C, Q, R)
    except DesignError as error:
        assert ':' in str(error) or 'reading' in str(error)
        return
    P = found.prior
    for each in (P, found.covariance):
        std = np.sqrt(each.diagonal())
        assert np.linalg.eigvalsh(each / np.outer(std, std)).min() > -1e-12
    after = found.covariance
    np.testing.assert_allclose(F @ after @ F.T + Q, P, rtol=1e-7, atol=1e-7 * np.abs(P).max())
    assert np.abs(found.poles).max() < 1.0


def scaled_problem(seed, spread):
    """Return a problem, and the same with every state in a unit of its own."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 7)), int(rng.integers(1, 3))
    A, B, N = rng.normal(size=(n, n)), rng.normal(size=(n, m)), 0.05 * rng.normal(size=(n, m))
    Q, R = np.diag(rng.uniform(0.1, 2.0, n)), np.diag(rng.uniform(0.1, 2.0, m))
    t = 10.0 ** rng.uniform(-spread, spread, n)
    across = np.outer(t, t)
    scaled = A * t[:, np.newaxis] / t, B * t[:, np.newaxis], Q / across, R, N / t[:, np.newaxis]
    return (A, B, Q, R, N), scaled, t


DESIGNS = {
    'lqr': lambda A, B, Q, R, N: lqr(A, B, Cost(Q, R, N)).gain,
    'dlqr': lambda A, B, Q, R, N: dlqr(A, B, Cost(Q, R, N)).gain,
    'sampled': lambda A, B, Q, R, N: kr.lqr(A, B, Q, R, N, dt=0.1).gain,
    'lqe': lambda A, B, Q, R, N: lqe(A.T, B.T, Q, R, N).gain.T,
    'dlqe': lambda A, B, Q, R, N: dlqe(A.T, B.T, Q, R, N).gain.T,
    'sampled filter': lambda A, B, Q, R, N: kr.lqe(A.T, B.T, Q, R, dt=0.1).gain.T,
}


@pytest.mark.parametrize('design', DESIGNS)
def test_the_units_of_the_states_change_no_gain(design):
    """Sixteen orders of magnitude between them; the solution has thirty-two."""
    for seed in range(6):
        given, scaled, t = scaled_problem(seed, 8.0)
        expected, found = DESIGNS[design](*given), DESIGNS[design](*scaled) * t
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize('design', DESIGNS)
def test_a_gain_in_absurd_units_is_right_or_refused(design):
    for seed in range(6):
        given, scaled, t = scaled_problem(seed, 30.0)
        try:
            found = DESIGNS[design](*scaled) * t
        except ValueError:
            continue
        expected = DESIGNS[design](*given)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_small_elements_of_a_sum_are_as_exact_as_large_ones():
    """Of states that have nothing to do with each other, ten orders apart."""
    A, W = np.diag([0.5, 0.999, 0.9999]), np.diag([1e9, 1e-9, 1e-12])
    expected = W.diagonal() / (1.0 - A.diagonal() ** 2)
    np.testing.assert_allclose(stein(A, W).diagonal(), expected, rtol=1e-12)


@pytest.mark.parametrize('design', [lqr, dlqr])
def test_a_solution_with_a_residual_is_refused(design, monkeypatch):
    problem = np.array([[0.0, 1.0], [2.0, -0.3]]), np.array([[0.0], [1.0]])
    design(*problem, cost([1, 1], [1], (2, 1)))
    monkeypatch.setattr(riccati, '_RESIDUAL', -1.0)
    with pytest.raises(DesignError, match='^input_cost: expected a size that can be weighed'):
        design(*problem, cost([1, 1], [1], (2, 1)))


def test_rounding_below_zero_is_taken_from_a_covariance_and_more_is_refused():
    Q = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]

    def with_least(size):
        return (Q * np.array([1.0, 0.5, size])) @ Q.T

    for S in (np.zeros((0, 0)), np.diag([1.0, 0.0]), with_least(1e-3)):
        assert riccati._semidefinite(S) is S
    for size in (-1e-15, -0.9 * riccati._LOST):
        found = riccati._semidefinite(with_least(size))
        assert np.linalg.eigvalsh(found)[0] >= -1e-16
        np.testing.assert_allclose(found, with_least(0.0), atol=1e-15)
    with pytest.raises(np.linalg.LinAlgError, match='not a covariance'):
        riccati._semidefinite(with_least(-1.1 * riccati._LOST))


def test_an_input_that_weighs_nothing_until_two_samples_later():
    # DAREX 1.1 itself: X = I; B'Q B is zero, and B'X B is not
    F, G, Q = np.array([[2.0, -1.0], [1.0, 0.0]]), np.array([[1.0], [0.0]]), np.diag([0.0, 1.0])
    none = np.zeros((1, 1))
    found = dlqr(F, G, Cost(Q, none, np.zeros((2, 1))))
    np.testing.assert_allclose(found.cost_to_go, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(found.gain, [[2.0, -1.0]], atol=1e-12)
    dual = dlqe(F.T, G.T, Q, none)
    np.testing.assert_allclose(dual.prior, np.eye(2), atol=1e-12)
    with pytest.raises(DesignError, match='positive definite'):
        dlqr(F, G, Cost(np.zeros((2, 2)), none, np.zeros((2, 1))))


def system(A, B):
    n, m = B.shape
    states, inputs = (Space(tuple(f'{s}{i}' for i in range(k)), ('',) * k)
                      for s, k in (('x', n), ('u', m)))  # fmt: skip
    return LinearSystem(A, B, np.zeros((n, n)), states, inputs)


@pytest.mark.parametrize('dt', [1e-9, 1e-10, 1e-12, 1e-300])
def test_a_sample_too_short_to_compute_with_is_continuous_time(dt):
    A, B = np.array([[-1.0, 0.3], [0.0, -2.0]]), np.array([[0.0], [1.0]])
    weights = Cost(np.eye(2), np.eye(1), np.zeros((2, 1)))
    found = sampled_lqr(system(A, B), weights, dt)
    np.testing.assert_allclose(found.gain, lqr(A, B, weights).gain, rtol=1e-6)
    assert np.all(np.abs(found.poles) <= 1.0)
    observer = sampled_lqe(A.T, B.T, np.eye(2), np.eye(1) / dt, dt)
    np.testing.assert_allclose(observer.gain / dt, lqr(A, B, weights).gain.T, rtol=1e-6)


def test_an_error_of_samples_says_that_the_numbers_are_theirs(monkeypatch):
    A, B = np.diag([1.0, 2.0]), np.array([[1.0], [0.0]])  # the second mode is out of reach
    weights = Cost(np.eye(2), np.eye(1), np.zeros((2, 1)))
    with pytest.raises(DesignError, match='no input can stabilise the modes at 2$'):
        sampled_lqr(system(A, B), weights, 0.1)

    def fail(*_):
        raise DesignError('input_cost: got the diagonal (0.1)')

    monkeypatch.setattr('kalman_ros.control.lqr.dlqr', fail)
    with pytest.raises(DesignError, match=r'got the diagonal \(0.1\), in samples of 0.1 s$'):
        sampled_lqr(system(*INTEGRATORS), weights, 0.1)


@pytest.mark.parametrize('count', [3, 5])
def test_an_input_at_the_end_of_a_chain_weighs_nothing_for_long(count):
    F, G = np.diag(np.ones(count - 1), 1), np.eye(count)[:, -1:]
    Q = np.diag([1.0, *np.zeros(count - 1)])
    found = dlqr(F, G, Cost(Q, np.zeros((1, 1)), np.zeros((count, 1))))
    # what is in the chain arrives, and costs once
    np.testing.assert_allclose(found.cost_to_go, np.eye(count), atol=1e-12)
    np.testing.assert_allclose(found.gain, np.zeros((1, count)), atol=1e-12)
