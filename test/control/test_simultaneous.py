# SPDX-License-Identifier: Apache-2.0
"""Margins of several loops at once: published, by brute force, and of one loop as before."""

import numpy as np
import pytest
from scipy.optimize import minimize
from seeds import first_fast
from test_margins import random_loop

from kalman_ros.control.lqr import cost, dlqr, lqr
from kalman_ros.control.margins import loop_at_a_time, margins
from kalman_ros.control.simultaneous import (
    _without,
    simultaneous_disk,
    structured_bound,
    structured_peak,
)
from kalman_ros.control.state_space import StateSpace, state_space, static
from kalman_ros.core import DesignError, zero_order_hold


def satellite(a=10.0):
    """The spinning satellite: G = [s - a^2, a (s + 1); -a (s + 1), s - a^2] / (s^2 + a^2)."""
    return state_space([[0, a], [-a, 0]], np.eye(2), [[1, a], [-a, 1]])


def test_the_satellite_is_as_published():
    # K. Zhou, J. Doyle and K. Glover, Robust and Optimal Control, 1996, section 9.6, and
    # S. Skogestad and I. Postlethwaite, Multivariable Feedback Control, 2005, section 3.7.1
    loop = satellite()
    for found in loop_at_a_time(loop):
        assert (found.lower_gain.value, found.upper_gain.value) == (0.0, np.inf)
        np.testing.assert_allclose(np.degrees(found.lag.value), 90.0)
        np.testing.assert_allclose((found.disk.alpha, found.distance.value), (2.0, 1.0))
    peak, frequency = structured_peak(loop.closed())
    np.testing.assert_allclose((peak, frequency), (np.sqrt(101.0), 0.0), atol=1e-9)
    found = simultaneous_disk(loop)
    assert 1.09 < found.upper_gain < 1.11 and np.degrees(found.phase) < 6.0
    # gains 1 + e and 1 - e are the end at e = 1 / sqrt(a^2 + 1)
    for e, stable in ((0.099, True), (0.1, False)):
        changed = StateSpace(loop.A, loop.B @ np.diag([1 + e, 1 - e]), loop.C, loop.D)
        assert changed.closed().stable == stable


def poles(loop, factors):
    """Return how far from stable the loop is with complex factors at its inputs."""
    F = np.diag(factors)
    E = np.linalg.inv(np.eye(len(F)) + loop.D @ F)
    found = np.linalg.eigvals(loop.A - loop.B @ F @ E @ loop.C)
    return np.abs(found).max() - 1.0 if loop.sampled else found.real.max()


def several(seed, dt):
    rng = np.random.default_rng(seed)
    n, m = 2 + seed % 3, 2 + seed % 2
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, m))
    weights = cost(rng.uniform(0.1, 1.0, n), rng.uniform(0.1, 1.0, m), (n, m))
    if dt is None:
        return state_space(A, B, lqr(A, B, weights).gain)
    F, G = zero_order_hold(A, B, dt)
    return state_space(F, G, dlqr(F, G, weights).gain, dt=dt)


@pytest.mark.slow
@pytest.mark.parametrize('dt', [None, 0.2])
@pytest.mark.parametrize('seed', first_fast(range(4), 2))
def test_the_end_of_the_margin_is_where_stability_ends(seed, dt):
    """Random changes within it keep the loop stable; the worst ones just beyond it do not."""
    loop = several(seed, dt)
    found, m = simultaneous_disk(loop), len(loop.D)
    rng = np.random.default_rng(seed)
    within = 0.999 * found.alpha * np.exp(2j * np.pi * rng.uniform(size=(2000, m)))
    assert all(poles(loop, (2.0 + d) / (2.0 - d)) < 0.0 for d in within)
    if found.alpha == 2.0:
        return

    def worst(angles):
        d = 1.001 * found.alpha * np.exp(1j * angles)
        return -poles(loop, (2.0 + d) / (2.0 - d))

    starts = sorted(rng.uniform(0, 2 * np.pi, size=(500, m)), key=worst)[:6]
    ends = [minimize(worst, start, method='Nelder-Mead', tol=1e-10).fun for start in starts]
    assert min(ends) < 0.0


@pytest.mark.parametrize('seed', first_fast(range(4), 2))
def test_the_peak_is_above_every_point_of_a_grid(seed):
    dt = 0.1 if seed % 2 else None
    loop = several(seed, dt)
    T, eye = loop.closed(), np.eye(len(loop.D))
    M = StateSpace(T.A, T.B, -2.0 * T.C, eye - 2.0 * T.D, T.dt)
    w = np.append(0.0, np.logspace(-3, 3, 60) if dt is None else np.linspace(0, np.pi / dt, 60))
    on_grid = max(structured_bound(point)[0] for point in M.response(w))
    peak, at = structured_peak(M)
    assert on_grid <= peak * (1.0 + 1e-6)
    if at < np.inf:
        np.testing.assert_allclose(structured_bound(M.response(at)[0])[0], peak, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize('size', [2, 3])
def test_the_bound_is_the_structured_singular_value(size):
    """From below mu is the largest |eigenvalue| of U M over diagonal unitary U."""
    rng = np.random.default_rng(size)
    for _ in range(5):
        M = rng.normal(size=(size, size)) + 1j * rng.normal(size=(size, size))
        M = M * 10.0 ** rng.uniform(-2, 2, (size, size))

        def radius(turns, M=M):
            U = np.exp(1j * np.append(0.0, turns))[:, np.newaxis]
            return -np.abs(np.linalg.eigvals(U * M)).max()

        starts = rng.uniform(0, 2 * np.pi, (12, size - 1))
        below = max(
            -minimize(radius, start, method='Nelder-Mead', tol=1e-12).fun for start in starts
        )
        bound, d = structured_bound(M)
        np.testing.assert_allclose(bound, below, rtol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(np.diag(d) @ M @ np.diag(1 / d), 2), bound)


@pytest.mark.parametrize(
    ('seed', 'dt'), first_fast([(seed, dt) for seed in range(6) for dt in (None, 0.1)], 4)
)
def test_of_one_loop_it_is_the_disk_margin(seed, dt):
    loop = random_loop(seed, dt)
    found, alone = simultaneous_disk(loop), margins(loop).disk
    np.testing.assert_allclose(found.alpha, alone.alpha, rtol=1e-5)


def test_loops_apart_have_the_smaller_of_their_margins():
    one, other = random_loop(1), random_loop(2)
    n, k = len(one.A), len(other.A)
    both = state_space(
        np.block([[one.A, np.zeros((n, k))], [np.zeros((k, n)), other.A]]),
        np.block([[one.B, np.zeros((n, 1))], [np.zeros((k, 1)), other.B]]),
        np.block([[one.C, np.zeros((1, k))], [np.zeros((1, n)), other.C]]),
    )
    least = min(margins(loop).disk.alpha for loop in (one, other))
    np.testing.assert_allclose(simultaneous_disk(both).alpha, least, rtol=1e-5)


def test_a_unit_of_an_input_does_not_matter():
    loop = several(3, None)
    units = np.array([1e-4, 1.0, 1e4])[: len(loop.D)]
    other = StateSpace(loop.A, loop.B * units, loop.C / units[:, np.newaxis], loop.D)
    np.testing.assert_allclose(
        simultaneous_disk(other).alpha, simultaneous_disk(loop).alpha, rtol=1e-5
    )


def test_gains_alone_and_what_is_unstable():
    assert simultaneous_disk(static(np.diag([0.5, 1.0]))).alpha == 2.0
    np.testing.assert_allclose(simultaneous_disk(static(np.diag([0.5, -0.5]))).alpha, 2.0 / 3.0)
    with pytest.raises(DesignError, match='loop: unstable when closed, with poles at 1'):
        simultaneous_disk(state_space([[2.0]], [[1.0]], [[1.0]]))


@pytest.mark.parametrize('ends', [(2.0, 2.0), (2.0, 3.0), (0.5, 2.0), (3.0, 9.0), (4.0, 9.0)])
def test_a_gap_is_searched_apart_from_what_is_covered(ends):
    """Else the search comes back to a peak, and the intervals that it may use run out."""
    low, high = 1.0, 4.0
    pieces = _without((low, high), ends)
    for start, end in pieces:
        assert low <= start < end <= high
        assert end <= ends[0] or start >= ends[1]
        if ends[0] == ends[1]:
            assert ends[0] not in (start, end)
    covered = min(high, ends[1]) - max(low, ends[0])
    length = sum(end - start for start, end in pieces)
    assert length == pytest.approx(high - low - max(covered, 0.0), rel=1e-5)


@pytest.mark.parametrize('faster', [1e-4, 1e4])
@pytest.mark.parametrize('seed', [6, 9])
def test_a_loop_that_is_slower_has_the_same_margin_at_a_lower_frequency(seed, faster):
    loop = several(seed, None)
    other = StateSpace(loop.A * faster, loop.B * faster, loop.C, loop.D)
    found, scaled = simultaneous_disk(loop), simultaneous_disk(other)
    np.testing.assert_allclose(scaled.alpha, found.alpha, rtol=1e-5)
    np.testing.assert_allclose(scaled.frequency, faster * found.frequency, rtol=1e-3)
