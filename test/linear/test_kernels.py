# SPDX-License-Identifier: Apache-2.0
"""Each kernel is its formula, for arrays of either order, and changes what it says, no more."""

import sys

import numpy as np
import pytest

from kalman_ros.linear import lapack, single

N, K, POINTS = 4, 2, 9
RNG = np.random.default_rng(0)


def covariance(size):
    root = RNG.normal(size=(size, size))
    return root @ root.T + np.eye(size)


F, H, G = RNG.normal(size=(N, N)), RNG.normal(size=(K, N)), RNG.normal(size=(N, K))
P, Q, R = covariance(N), covariance(N), covariance(K)
x, z = RNG.normal(size=N), RNG.normal(size=K)
D, E = RNG.normal(size=(N, POINTS)), RNG.normal(size=(K, POINTS))
S = H @ P @ H.T + R
GAIN = P @ H.T @ np.linalg.inv(S)
KEPT = np.eye(N) - G @ H

CASES = {
    'corrected': (single.corrected, (x, G, z), x + G @ z),
    'sandwich': (single.sandwich, (H, P, R), S),
    'divided': (single.divided, (H @ P, S), GAIN),
    'joseph': (single.joseph, (G, H, P, R), KEPT @ P @ KEPT.T + G @ R @ G.T),
    'mirrored': (single.mirrored, (np.triu(P),), P),
    'scaled': (single.scaled, (F, D), F @ D),
    'points_about': (single.points_about, (x, D), (D + x[:, np.newaxis]).T),
    'moments': (single.moments, (D, D, Q), D @ D.T + Q),
    'cross moments': (single.moments, (E, D), E @ D.T),
    'through_gain': (single.through_gain, (G, R), G @ R @ G.T),
    'weighed': (single.weighed, (R, z), z @ np.linalg.solve(R, z)),
}


@pytest.mark.parametrize('order', ['C', 'F'])
@pytest.mark.parametrize('name', CASES)
def test_a_kernel_is_its_formula(name, order):
    kernel, arguments, expected = CASES[name]
    given = [np.array(a, order=order) if isinstance(a, np.ndarray) else a for a in arguments]
    before = [np.copy(a) for a in given]
    np.testing.assert_allclose(kernel(*given), expected, rtol=1e-11, atol=1e-12)
    for argument, same in zip(given, before):
        np.testing.assert_array_equal(argument, same)


@pytest.mark.parametrize('order', ['C', 'F'])
def test_what_is_written_into_is_the_last_term(order):
    moved = single.affine(np.array(F, order=order), x, Q, x)
    np.testing.assert_allclose(moved, F @ x + Q @ x)
    found = single.remainder(np.array(D, order=order), GAIN, np.array(E, order=order))
    np.testing.assert_allclose(found, D - GAIN @ E)


def test_a_gain_comes_with_its_innovation_covariance():
    gain, innovation_covariance = single.gain(P, H, R)
    np.testing.assert_allclose(gain, GAIN)
    np.testing.assert_allclose(innovation_covariance, S)


def test_a_covariance_is_symmetric_to_the_last_bit():
    found = single.joseph(G, H, P, R)
    np.testing.assert_array_equal(found, found.T)


def test_what_is_not_definite_has_no_gain_and_no_weight():
    with pytest.raises(np.linalg.LinAlgError, match='not positive definite'):
        single.divided(H @ P, -S)
    assert single.weighed(-R, z) == np.inf
    assert single.is_definite(P) and not single.is_definite(-P)


def test_without_the_private_modules_the_public_ones_serve(monkeypatch):
    """Where scipy keeps its extension modules elsewhere, `scipy.linalg` is imported as a whole."""
    monkeypatch.setattr(lapack, 'EXTENSION_SUFFIXES', [])
    blas, routines = lapack._load('blas'), lapack._load('lapack')
    assert blas is sys.modules['scipy.linalg.blas']
    assert routines is sys.modules['scipy.linalg.lapack']
    np.testing.assert_array_equal(blas.dgemm(1.0, H, P), lapack.dgemm(1.0, H, P))
    np.testing.assert_array_equal(routines.dposv(S, H @ P)[1], lapack.dposv(S, H @ P)[1])
