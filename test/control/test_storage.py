# SPDX-License-Identifier: Apache-2.0
"""Storage functions: the inequalities that they prove, and the parts of their computation."""

import numpy as np
import pytest

from kalman_ros.control import storage
from kalman_ros.control.storage import cost_to_go, decrease, storage_function

RNG = np.random.default_rng(0)
ROOT = RNG.normal(size=(3, 3))
P = ROOT @ ROOT.T + np.diag([1.0, 10.0, 100.0])
M = np.concatenate((0.2 * RNG.normal(size=(7, 3, 5)), RNG.normal(size=(7, 2, 5))), axis=1)
LEVEL = 3.0


def least(S):
    return np.linalg.eigvalsh(S).min()


def test_the_form_is_what_the_inequality_lacks():
    floor, margin = np.diag([0.1, 0.2, 0.3]), 0.05
    weight = np.zeros((5, 5))
    weight[:3, :3], weight[3:, 3:] = P, np.eye(2)
    bound = np.zeros((5, 5))
    bound[:3, :3], bound[3:, 3:] = P, LEVEL**2 * np.eye(2)
    expected = M.swapaxes(1, 2) @ weight @ M - (1.0 - margin) * bound
    expected[:, :3, :3] += floor
    found = storage._form(M, np.tile(P, (7, 1, 1)), floor, LEVEL, margin)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    alone = storage._form(M[:, :, :3], np.tile(P, (7, 1, 1)), floor, np.inf, margin)
    np.testing.assert_allclose(alone, expected[:, :3, :3], atol=1e-9)


def test_the_excess_is_that_of_the_worst_input():
    form = storage._form(M, np.tile(P, (7, 1, 1)), np.zeros((3, 3)), 9.0, 0.0)
    excess, x = storage._excess(form, 3), RNG.normal(size=3)
    for F, E in zip(form, excess):
        w = np.linalg.solve(-F[3:, 3:], F[3:, :3] @ x)
        both = np.r_[x, w]
        assert both @ F @ both == pytest.approx(x @ E @ x)
        for other in RNG.normal(size=(5, 2)):
            both = np.r_[x, w + other]
            assert both @ F @ both < x @ E @ x
    np.testing.assert_array_equal(storage._excess(form[:, :3, :3], 3), form[:, :3, :3])
    unbounded = form.copy()
    unbounded[4, 3, 3] = 1e-9
    assert storage._excess(unbounded, 3) is None


def test_the_margin_covers_what_matrices_differ_by():
    """For matrices that are at most 1 in norm in these units, twice the difference of each."""
    bound = np.zeros((5, 5))
    bound[:3, :3], bound[3:, 3:] = P, LEVEL**2 * np.eye(2)
    weight = bound.copy()
    weight[3:, 3:] = np.eye(2)
    left, right = np.linalg.cholesky(weight).T, np.linalg.inv(np.linalg.cholesky(bound).T)
    back = np.linalg.solve(left, np.linalg.qr(RNG.normal(size=(5, 5)))[0]) @ np.linalg.inv(right)
    rest = 1e-2 * RNG.normal(size=(4, 5, 5))
    size = 2.0 * np.linalg.norm(left @ rest @ right, 2, axis=(1, 2)).max()
    margin = storage._margin(rest, P, LEVEL)
    assert margin == pytest.approx(2.0 * size + size**2)
    for each in (*rest, *-rest):
        grown = (back + 2.0 * each).T @ weight @ (back + 2.0 * each)
        assert least((1.0 + margin) * bound - grown) > -1e-9
    assert storage._margin(np.zeros((0, 5, 5)), P, LEVEL) == 0.0


def test_a_cover_is_at_least_each_and_little_more():
    matrices = RNG.normal(size=(6, 3, 3))
    matrices = matrices + matrices.swapaxes(1, 2)
    start = np.diag([0.1, 0.2, 0.3])
    cover = storage._cover(matrices, start, P)
    for each in (*matrices, start):
        assert least(cover - each) > -1e-9
    np.testing.assert_allclose(storage._cover(-matrices @ matrices, start, P), start, atol=1e-12)
    (one,) = storage._cover(matrices[:1], np.zeros((3, 3)), np.eye(3))[np.newaxis]
    values, vectors = np.linalg.eigh(matrices[0])
    np.testing.assert_allclose(one, (vectors * np.maximum(values, 0.0)) @ vectors.T, atol=1e-12)


def test_the_matrix_that_lacks_most_is_covered_first():
    """Not so, the multiple of the identity at the end is as large as that matrix."""
    small = 1e-3 * np.array([np.eye(4) + 0.1 * np.outer(v, v) for v in RNG.normal(size=(20, 4))])
    large = np.outer([1.0, 2.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.0])
    cover = storage._cover(np.vstack((small, large[np.newaxis])), np.zeros((4, 4)), np.eye(4))
    assert np.trace(cover) < 1.1 * np.trace(large)


@pytest.mark.parametrize('pole', [0.0, 0.5, -0.9])
def test_the_cost_to_go_is_the_sum_along_the_loop(pole):
    A, Q = np.diag([pole, 0.3]), np.array([[2.0, 0.5], [0.5, 1.0]])
    powers = [np.linalg.matrix_power(A, k) for k in range(400)]
    expected = sum(F.T @ Q @ F for F in powers)
    np.testing.assert_allclose(cost_to_go(A, Q), expected, rtol=1e-9)


@pytest.mark.parametrize('pole', [1.0, -1.0, 1.0 - 0.9e-9, 1.1])
def test_without_stability_there_is_no_cost_to_go(pole):
    assert cost_to_go(np.diag([pole, 0.3]), np.eye(2)) is None


def test_the_decrease_is_a_thousandth_of_the_cost():
    A, C = np.array([[0.5, 0.1], [0.0, 0.8]]), np.array([[1.0, 0.0]])
    noise = np.diag([1.0, 2.0])
    found = decrease(np.vstack((A, C)), noise)
    covariance = cost_to_go(A.T, noise)
    cost = (C @ covariance @ C.T).item()
    assert np.trace(found @ covariance) == pytest.approx(1e-3 * cost, rel=1e-5)
    assert least(found) > 0.0
    assert decrease(np.vstack((1.1 * np.eye(2), C)), noise) is None


@pytest.mark.parametrize('gain', [0.99, 1.01])
def test_a_gain_below_the_level_has_a_storage_function(gain):
    """x' = a x + w, z = x has the gain 1 / (1 - |a|)."""
    poles = np.array([0.4, 0.5, 0.6])
    grid = np.array([[[a, 1.0], [1.0, 0.0]] for a in poles])
    rest, floor = np.zeros((1, 2, 2)), 1e-6 * np.eye(1)
    found = storage_function(grid, rest, (1.0 / 0.4) / gain, floor)
    assert (found is not None) is (gain < 1.0)
    if found is not None:
        for a, p in zip(np.linspace(0.4, 0.6, len(found)), found[:, 0, 0]):
            lacking = np.array([[a * a * p + 1.0 - p, a * p], [a * p, p - (2.5 / gain) ** 2]])
            assert np.linalg.eigvalsh(lacking).max() < 0.0
        assert storage_function(grid, rest, 2.5 / gain, floor, lambda P: P.max() < 1.0) is None
