# SPDX-License-Identifier: Apache-2.0
"""Where a loop crosses the real axis or a circle, against roots found by bisection."""

import numpy as np
import pytest
from scipy.optimize import brentq

from kalman_ros.control import crossings
from kalman_ros.control.crossings import (
    balanced,
    continuous,
    frequency,
    level_candidates,
    level_crossings,
    real_crossings,
    singular_crossings,
)
from kalman_ros.control.state_space import StateSpace
from kalman_ros.linear.discretize import zero_order_hold

#: 6 / (s (s + 1) (s + 2)), with a loop that is real at the root of 2.
LOOP = StateSpace(
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -2.0, -3.0]]),
    np.array([[0.0], [0.0], [1.0]]), np.array([[6.0, 0.0, 0.0]]), np.zeros((1, 1)),
)  # fmt: skip
#: 1 / (s^2 + 0.1 s + 1), with a peak of 10.
PEAK = StateSpace(
    np.array([[0.0, 1.0], [-1.0, -0.1]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]),
    np.zeros((1, 1)),
)  # fmt: skip


def value(system, w):
    x = np.linalg.solve(1j * w * np.eye(len(system.A)) - system.A, system.B)
    return system.C @ x + system.D


def size(system, w):
    return np.linalg.norm(value(system, w), 2)


def test_a_loop_of_three_lags_is_real_once():
    np.testing.assert_allclose(real_crossings(LOOP), [2.0**0.5], rtol=1e-12)
    assert value(LOOP, 2.0**0.5)[0, 0] == pytest.approx(-1.0)
    assert real_crossings(PEAK).size == 0


@pytest.mark.parametrize('level', [0.1, 1.0, 30.0])
def test_a_loop_that_falls_has_a_size_once(level):
    expected = brentq(lambda w: size(LOOP, w) - level, 1e-3, 1e3, xtol=1e-14, rtol=1e-13)
    np.testing.assert_allclose(level_crossings(LOOP, level), [expected], rtol=1e-10)
    if level == 1.0:
        np.testing.assert_allclose(level_crossings(LOOP), [expected], rtol=1e-10)


@pytest.mark.parametrize(('level', 'count'), [(0.5, 1), (2.0, 2), (9.9, 2), (10.2, 0)])
def test_a_peak_is_crossed_twice(level, count):
    found = level_crossings(PEAK, level)
    assert len(found) == count
    np.testing.assert_allclose([size(PEAK, w) for w in found], level, rtol=1e-9)
    assert (np.diff(found) > 0.0).all()
    np.testing.assert_allclose(singular_crossings(PEAK, level), found, rtol=1e-6)
    candidates = level_candidates(PEAK, level)
    assert all(np.isclose(candidates, w, rtol=1e-6).any() for w in found)
    assert len(candidates) >= count


def test_singular_values_cross_one_by_one():
    both = StateSpace(
        np.block([[PEAK.A, np.zeros((2, 3))], [np.zeros((3, 2)), LOOP.A]]),
        np.block([[PEAK.B, np.zeros((2, 1))], [np.zeros((3, 1)), LOOP.B]]),
        np.block([[PEAK.C, np.zeros((1, 3))], [np.zeros((1, 2)), LOOP.C]]), np.zeros((2, 2)),
    )  # fmt: skip
    found = singular_crossings(both, 2.0)
    expected = np.sort([*level_crossings(PEAK, 2.0), *level_crossings(LOOP, 2.0)])
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize('gain', [1.0, 0.6])
def test_a_feedthrough_counts(gain):
    system = StateSpace(-np.eye(1), np.eye(1), np.eye(1), gain * np.eye(1))
    # |j w + 1 + 1 / gain| = |j w + 1| / gain for a level of 1, 1 / (s + 1) + gain
    found = level_crossings(system, 1.0)
    if gain == 1.0:
        assert found.size == 0  # it is above for all finite w
    else:
        w = brentq(lambda w: size(system, w) - 1.0, 0.01, 100.0, rtol=1e-13)
        np.testing.assert_allclose(found, [w], rtol=1e-10)


def test_states_of_other_units_give_the_same_crossings():
    scale = np.array([1e-6, 1.0, 1e7])
    other = StateSpace(
        LOOP.A * scale / scale[:, np.newaxis], LOOP.B / scale[:, np.newaxis], LOOP.C * scale,
        LOOP.D,
    )  # fmt: skip
    found = balanced(other)
    for w in (0.1, 1.0, 10.0):
        np.testing.assert_allclose(value(found, w), value(LOOP, w), rtol=1e-9)
    entries = np.abs(np.concatenate([found.A.ravel(), found.B.ravel(), found.C.ravel()]))
    entries = entries[entries > 0.0]
    assert entries.max() / entries.min() < 1e3
    np.testing.assert_allclose(real_crossings(found), [2.0**0.5], rtol=1e-10)


@pytest.mark.parametrize('dt', [0.05, 0.5])
def test_a_sampled_loop_has_its_values_at_frequencies_that_are_bent(dt):
    F, G = zero_order_hold(PEAK.A, PEAK.B, dt)
    sampled = StateSpace(F, G, PEAK.C, PEAK.D, dt)
    bent = continuous(sampled)
    for w in (0.1, 0.9, 2.0):
        axis = 2.0 / dt * np.tan(0.5 * w * dt)
        assert frequency(axis, dt) == pytest.approx(w)
        z = np.exp(1j * w * dt)
        exact = PEAK.C @ np.linalg.solve(z * np.eye(2) - F, G)
        np.testing.assert_allclose(value(bent, axis), exact, rtol=1e-9)
    assert frequency(3.0, None) == 3.0
    assert bent.dt is None


def test_an_alternating_mode_is_moved_and_then_bent():
    for pole in (-1.0, -1.0 + 1e-11):
        sampled = StateSpace(np.diag([pole, 0.5]), np.ones((2, 1)), np.ones((1, 2)),
                             np.zeros((1, 1)), 0.1)  # fmt: skip
        bent = continuous(sampled)
        for w in (0.1, 0.9, 20.0):
            exact = 1.0 / (np.exp(0.1j * w) + 1.0) + 1.0 / (np.exp(0.1j * w) - 0.5)
            axis = 20.0 * np.tan(0.05 * w)
            np.testing.assert_allclose(value(bent, axis), exact, rtol=1e-5)


def test_a_start_without_a_root_nearby_is_no_crossing():
    assert crossings._newton(lambda w: (w * w + 1.0, 2.0 * w, 1.0), 1.0) is None
    assert crossings._newton(lambda w: (w - 2.0, 1.0, 1.0), 1.9) == pytest.approx(2.0)
    assert crossings._newton(lambda w: (1.0, 0.0, 1.0), 1.0) is None
    # a root that is far away is approached by no more than a factor of two a step
    seen = []

    def far(w):
        seen.append(w)
        return w - 100.0, 1.0, 1.0

    assert crossings._newton(far, 1.0) == pytest.approx(100.0)
    assert seen[:4] == [1.0, 2.0, 4.0, 8.0]

    def singular(w):
        raise np.linalg.LinAlgError

    assert crossings._newton(singular, 1.0) is None
