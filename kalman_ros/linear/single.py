# SPDX-License-Identifier: Apache-2.0
"""Named products of the matrices of one belief, by BLAS and LAPACK.

Filters written with these names read like the textbook. Each is one or two calls into `lapack`:
for matrices of a few rows the calls themselves take the time, and a product with a sum is one.
Arrays of any order are accepted; column-major ones, as returned here, are not copied. What stands
in `batched`, too, does there the same for many beliefs.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .factor import cholesky
from .lapack import dgemm, dgemv, dger, dposv, dpotrf, dsymm, dtrtri
from .matrices import Array, identity


def affine(F: Array, x: Array, G: Array, u: Array) -> Array:
    """Return F x + G u (n,)."""
    moved: Array = dgemv(1.0, F, x, 1.0, G.dot(u), 0, 1, 0, 1, 0, 1)
    return moved


def corrected(x: Array, K: Array, innovation: Array) -> Array:
    """Return x + K innovation (n,), with a gain ``K`` (n, k)."""
    mean: Array = dgemv(1.0, K.T, innovation, 1.0, x, 0, 1, 0, 1, 1)
    return mean


def sandwich(F: Array, P: Array, Q: Array) -> Array:
    """Return F P F' + Q (k, k): a covariance ``P`` (n, n) seen through ``F`` (k, n), and noise."""
    covariance: Array = dgemm(1.0, dgemm(1.0, F, P), F, 1.0, Q, 0, 1)
    return covariance


def ordered(H: Array, R: Array) -> tuple[Array, Array]:
    """Return ``H``, and a symmetric ``R``, in the order in memory that is not copied."""
    return np.asfortranarray(H), R.T


def gain(P: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Return K = P H' S^-1 (n, k) and S = H P H' + R (k, k).

    Raises
    ------
    numpy.linalg.LinAlgError
        If S is not positive definite.
    """
    HP = dgemm(1.0, H, P)
    S = dgemm(1.0, HP, H, 1.0, R, 0, 1)
    return divided(HP, S), S


def divided(C: Array, S: Array) -> Array:
    """Return C' S^-1 (n, k), the gain from a cross covariance ``C`` (k, n), by factoring ``S``.

    Raises
    ------
    numpy.linalg.LinAlgError
        If ``S`` (k, k) is not positive definite.
    """
    _, solved, info = dposv(S, C)
    if info != 0:
        raise np.linalg.LinAlgError('the innovation covariance is not positive definite')
    K: Array = solved.T
    return K


def joseph(K: Array, H: Array, P: Array, R: Array) -> Array:
    """Return (I - K H) P (I - K H)' + K R K' (n, n), symmetric to the last bit.

    The Joseph form: a sum of two positive semi-definite terms for every gain
    ``K`` (n, k) is (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
    Navigation, 2001, equation 5.2.3-18).
    """
    # `through_gain` and `mirrored` in place: this is the longest part of a step
    eye, Kt = identity(len(P)), K.T
    I_KH = dgemm(-1.0, Kt, H, 1.0, eye, 1)
    KRK = dgemm(1.0, dgemm(1.0, Kt, R, 0.0, None, 1), Kt)
    symmetric: Array = dsymm(1.0, dgemm(1.0, dgemm(1.0, I_KH, P), I_KH, 1.0, KRK, 0, 1, 1), eye)
    return symmetric


def mirrored(P: Array) -> Array:
    """Return the symmetric matrix whose upper triangle is that of ``P`` (n, n)."""
    symmetric: Array = dsymm(1.0, P, identity(len(P)))
    return symmetric


def repaired_factor(P: Array) -> Array:
    """Return L (n, n), lower triangular, with L L' = P, or what `factor.cholesky` makes of P.

    Raises
    ------
    numpy.linalg.LinAlgError
        If there is none.
    """
    return cholesky(P)[0]


def scaled(L: Array, directions: Array) -> Array:
    """Return L directions (n, p): points of a standard Gaussian, in units of ``L`` (n, n)."""
    offsets: Array = dgemm(1.0, L, directions)
    return offsets


def points_about(mean: Array, offsets: Array) -> Array:
    """Return the points (p, n) at ``mean`` (n,) plus each column of ``offsets`` (n, p)."""
    points: Array = dger(1.0, mean, _ones(offsets.shape[1]), 1, 1, offsets)
    return np.asarray(points.T)


def as_columns(points: Array) -> Array:
    """Return the matrix (n, p) with the ``points`` (p, n) as its columns."""
    return np.asarray(points.T)


def moments(weighted: Array, d: Array, Q: Array | None = None) -> Array:
    """Return the sum of W e d' + Q (k, n), over the columns of W e (k, p) and ``d`` (n, p)."""
    if Q is None:
        cross: Array = dgemm(1.0, weighted, d, 0.0, None, 0, 1)
        return cross
    covariance: Array = dgemm(1.0, weighted, d, 1.0, Q, 0, 1)
    return covariance


def remainder(dx: Array, K: Array, dy: Array) -> Array:
    """Return dx - K dy (n, p), the deviations after a reading; ``dx`` is overwritten."""
    left: Array = dgemm(-1.0, K.T, dy, 1.0, dx, 1, 0, 1)
    return left


def through_gain(K: Array, R: Array) -> Array:
    """Return K R K' (n, n), the noise of a reading added through a gain ``K`` (n, k)."""
    Kt = K.T
    added: Array = dgemm(1.0, dgemm(1.0, Kt, R, 0.0, None, 1), Kt)
    return added


def is_definite(P: Array) -> bool:
    """Return whether a symmetric ``P`` (n, n) is positive definite, by factoring it."""
    return bool(dpotrf(P, lower=1)[1] == 0)


def weighed(S: Array, z: Array) -> float:
    """Return z' S^-1 z, infinite where ``S`` (k, k) is not positive definite."""
    _, solved, info = dposv(S, z)
    return float(z.dot(solved)) if info == 0 else float('inf')


def whitening(S: Array) -> Array:
    """Return L^-1 (k, k) with L L' = S, L lower triangular.

    Raises
    ------
    numpy.linalg.LinAlgError
        If S is not positive definite.
    """
    L, info = dpotrf(S, 1, 1)
    if info != 0:
        raise np.linalg.LinAlgError('the innovation covariance is not positive definite')
    inverse: Array = dtrtri(L, 1)[0]
    return inverse


@lru_cache(maxsize=64)
def _ones(p: int) -> Array:
    return np.ones(p)
