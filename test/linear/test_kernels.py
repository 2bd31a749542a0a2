# SPDX-License-Identifier: Apache-2.0
"""Each kernel is its formula, for arrays of either order, and changes what it says, no more."""

import sys

import numpy as np
import pytest

from kalman_ros.linear import kernels, lapack

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
    'corrected': (kernels.corrected, (x, G, z), x + G @ z),
    'sandwich': (kernels.sandwich, (H, P, R), S),
    'divided': (kernels.divided, (H @ P, S), GAIN),
    'joseph': (kernels.joseph, (G, H, P, R), KEPT @ P @ KEPT.T + G @ R @ G.T),
    'mirrored': (kernels.mirrored, (np.triu(P),), P),
    'scaled': (kernels.scaled, (F, D), F @ D),
    'plus_each': (kernels.plus_each, (D, x, -1.0), D - x[:, np.newaxis]),
    'moments': (kernels.moments, (D, D, Q), D @ D.T + Q),
    'cross moments': (kernels.moments, (E, D), E @ D.T),
    'through_gain': (kernels.through_gain, (G, R), G @ R @ G.T),
    'weighed': (kernels.weighed, (R, z), z @ np.linalg.solve(R, z)),
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
    moved = kernels.affine(np.array(F, order=order), x, Q[0].copy())
    np.testing.assert_allclose(moved, F @ x + Q[0])
    found = kernels.remainder(np.array(D, order=order), GAIN, np.array(E, order=order))
    np.testing.assert_allclose(found, D - GAIN @ E)


def test_a_gain_comes_with_its_innovation_covariance():
    gain, innovation_covariance = kernels.gain(P, H, R)
    np.testing.assert_allclose(gain, GAIN)
    np.testing.assert_allclose(innovation_covariance, S)


def test_a_covariance_is_symmetric_to_the_last_bit():
    found = kernels.joseph(G, H, P, R)
    np.testing.assert_array_equal(found, found.T)


def test_what_is_not_definite_has_no_gain_and_no_weight():
    with pytest.raises(np.linalg.LinAlgError, match='not positive definite'):
        kernels.divided(H @ P, -S)
    assert kernels.weighed(-R, z) == np.inf
    assert kernels.is_definite(P) and not kernels.is_definite(-P)


def test_without_the_private_modules_the_public_ones_serve(monkeypatch):
    """Where scipy keeps its extension modules elsewhere, `scipy.linalg` is imported as a whole."""
    monkeypatch.setattr(lapack, 'EXTENSION_SUFFIXES', [])
    blas, routines = lapack._load('blas'), lapack._load('lapack')
    assert blas is sys.modules['scipy.linalg.blas']
    assert routines is sys.modules['scipy.linalg.lapack']
    np.testing.assert_array_equal(blas.dgemm(1.0, H, P), lapack.dgemm(1.0, H, P))
    np.testing.assert_array_equal(routines.dposv(S, H @ P)[1], lapack.dposv(S, H @ P)[1])
