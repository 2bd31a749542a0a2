# SPDX-License-Identifier: Apache-2.0
"""The named products of `single` for stacks of matrices: any leading axes, all at once.

Matrices are (..., n, n), vectors (..., n); leading axes broadcast, so that what is the same for
all members of a batch is computed once. Large batches are fastest with the batch last in memory,
which results keep: each entry of a matrix is then one contiguous array.
"""

from __future__ import annotations

import numpy as np

from .factor import cholesky
from .matrices import Array
from .views import coordinates, coordinates_last, entries_first, entries_last

#: From this size on, in numbers, `einsum` is faster than a call of BLAS for each matrix.
MANY = 2000


def product(A: Array, B: Array) -> Array:
    """Return A B (..., n, k) for A (..., n, m) and B (..., m, k)."""
    if A.ndim == B.ndim == 2:
        return np.asarray(A.dot(B))
    if max(A.size, B.size) < MANY:
        return np.asarray(A @ B)
    if A.ndim == 2:
        return _of_one(A, B)
    if B.ndim == 2:
        return np.asarray(_of_one(B.T, A.swapaxes(-1, -2)).swapaxes(-1, -2))
    return np.asarray(np.einsum('...ij,...jk->...ik', A, B))


def _of_one(A: Array, B: Array) -> Array:
    """Return A B (..., n, k) for one A (n, m), as a single product."""
    entries = entries_first(B)
    flat = A.dot(entries.reshape(len(entries), -1))
    return entries_last(flat.reshape(len(A), *entries.shape[1:]))


def product_transposed(A: Array, B: Array) -> Array:
    """Return A B' (..., n, k) for A (..., n, m) and B (..., k, m)."""
    return product(A, B.swapaxes(-1, -2))


def times(A: Array, x: Array) -> Array:
    """Return A x (..., n) for A (..., n, m) and x (..., m)."""
    if x.ndim == 1 and A.ndim == 2:
        return np.asarray(A.dot(x))
    if A.ndim == x.ndim == 2:
        return np.asarray(A.dot(x.T).T)
    if A.ndim == 2:
        return np.asarray(x.dot(A.T))
    return np.asarray(np.einsum('...ij,...j->...i', A, x))


def affine(F: Array, x: Array, G: Array, u: Array) -> Array:
    """Return F x + G u (..., n)."""
    return times(F, x) + times(G, u)


def corrected(x: Array, K: Array, innovation: Array) -> Array:
    """Return x + K innovation (..., n), with gains ``K`` (..., n, k)."""
    return x + times(K, innovation)


def sandwich(F: Array, P: Array, Q: Array) -> Array:
    """Return F P F' + Q (..., k, k): a covariance ``P`` seen through ``F`` (..., k, n)."""
    return product_transposed(product(F, P), F) + Q


def symmetric(P: Array) -> Array:
    """Return the symmetric part of ``P`` (..., n, n), in the same order in memory."""
    doubled: Array = P + P.swapaxes(-1, -2)
    doubled *= 0.5
    return doubled


def factor(P: Array) -> Array:
    """Return L (..., n, n), lower triangular, with L L' = P; NaN where P is not definite."""
    if P.size < MANY:
        try:
            return np.asarray(np.linalg.cholesky(P))
        except np.linalg.LinAlgError:
            pass  # which of them is not is found below
    with np.errstate(invalid='ignore', divide='ignore'):
        return _columns(P, np.nan)


def repaired_factor(P: Array) -> Array:
    """Return the `factor` of P, repaired as `factor.cholesky` does where P is not definite."""
    L = factor(P)
    bad = ~np.isfinite(L).all(axis=(-2, -1))
    if bad.any():
        for at in np.argwhere(bad).tolist():
            try:
                L[tuple(at)] = cholesky(P[tuple(at)])[0]
            except np.linalg.LinAlgError:
                L[tuple(at)] = np.nan
    return L


def semidefinite_factor(P: Array, tolerance: float = 1e-12) -> Array:
    """Return M (..., n, n) with M M' = P for a semi-definite ``P``, zeros where it is singular.

    A pivot that is less than ``tolerance`` of its variance is rounding. Unlike the root by
    eigenvectors, which are arbitrary for eigenvalues that are close, M changes little with P.
    """
    return _columns(P, tolerance)


def _columns(P: Array, tolerance: float) -> Array:
    """Return the factor of Cholesky column by column, for all matrices at once.

    A column whose pivot is not more than ``tolerance`` of its variance is zero; with NaN for the
    tolerance none is.
    """
    entries = entries_first(P)
    n = len(entries)
    L = np.zeros_like(entries, order='C')
    for j in range(n):
        column = entries[j:, j].copy()
        if P.ndim == 2:
            column -= L[j:, :j].dot(L[j, :j])
        else:
            for k in range(j):
                column -= L[j:, k] * L[j, k]
        pivot = column[0]
        if tolerance == tolerance:
            good = pivot > tolerance * entries[j, j]
            scale = np.where(good, 1.0, 0.0) / np.sqrt(np.where(good, pivot, 1.0))
        else:
            scale = 1.0 / np.sqrt(np.where(pivot > 0.0, pivot, np.nan))
        L[j:, j] = column * scale
    return entries_last(L)


def whitened(L: Array, v: Array) -> Array:
    """Return L^-1 v (..., n) for a lower triangular ``L`` (..., n, n), by substitution."""
    n = v.shape[-1]
    z: list[Array] = []
    for i in range(n):
        left = v[..., i]
        for j in range(i):
            left = left - L[..., i, j] * z[j]
        z.append(left / L[..., i, i])
    return _coordinates(z)


def _solved(L: Array, B: Array) -> Array:
    """Return (L L')^-1 B (..., k, n) for a lower triangular ``L`` (..., k, k)."""
    k = L.shape[-1]
    rows = [B[..., i, :] for i in range(k)]
    for i in range(k):
        for j in range(i):
            rows[i] = rows[i] - L[..., i, j, np.newaxis] * rows[j]
        rows[i] = rows[i] / L[..., i, i, np.newaxis]
    for i in reversed(range(k)):
        for j in range(i + 1, k):
            rows[i] = rows[i] - L[..., j, i, np.newaxis] * rows[j]
        rows[i] = rows[i] / L[..., i, i, np.newaxis]
    return np.moveaxis(np.stack(np.broadcast_arrays(*rows)), 0, -2)


def _coordinates(parts: list[Array]) -> Array:
    return coordinates_last(np.array(np.broadcast_arrays(*parts)))


def ordered(H: Array, R: Array) -> tuple[Array, Array]:
    """Return ``H`` and ``R``, in whatever order in memory."""
    return H, R


def gain(P: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Return K = P H' S^-1 (..., n, k) and S = H P H' + R (..., k, k).

    K is NaN where S is not positive definite.
    """
    HP = product(H, P)
    S = symmetric(product_transposed(HP, H) + R)
    return divided(HP, S), S


def divided(C: Array, S: Array) -> Array:
    """Return C' S^-1 (..., n, k), the gain from cross covariances ``C`` (..., k, n)."""
    L = factor(S)
    if L.shape[-1] == 1:
        return np.asarray((C / (L * L)).swapaxes(-1, -2))
    if max(C.size, L.size) < MANY:
        inverse = np.linalg.inv(L)
        return np.asarray((inverse @ C).swapaxes(-1, -2) @ inverse)
    return np.asarray(_solved(L, C).swapaxes(-1, -2))


def joseph(K: Array, H: Array, P: Array, R: Array) -> Array:
    """Return (I - K H) P (I - K H)' + K R K' (..., n, n), symmetric, as `kernels.joseph` does."""
    I_KH: Array = np.eye(K.shape[-2]) - product(K, H)
    return symmetric(sandwich(I_KH, P, sandwich(K, R, np.zeros(()))))


def scaled(L: Array, directions: Array) -> Array:
    """Return L directions (..., n, p): points of standard Gaussians, in units of ``L``."""
    return product(L, directions)


def points_about(mean: Array, offsets: Array) -> Array:
    """Return the points (p, ..., n) at ``mean`` (..., n) plus the columns of ``offsets``."""
    if offsets.ndim == 2:
        offsets = offsets.reshape(*(1,) * (mean.ndim - 1), *offsets.shape)
    return coordinates(offsets) + mean


def as_columns(points: Array) -> Array:
    """Return the matrices (..., n, p) with the ``points`` (p, ..., n) as their columns."""
    return coordinates_last(points)


def moments(weighted: Array, d: Array, Q: Array | None = None) -> Array:
    """Return the sum of W e d' + Q (..., k, n), over the columns of W e and ``d``."""
    total = product_transposed(weighted, d)
    return total if Q is None else total + Q


def remainder(dx: Array, K: Array, dy: Array) -> Array:
    """Return dx - K dy (..., n, p), the deviations after a reading."""
    return dx - product(K, dy)


def through_gain(K: Array, R: Array) -> Array:
    """Return K R K' (..., n, n), the noise of a reading added through gains ``K``."""
    return sandwich(K, R, np.zeros(()))


def mirrored(P: Array) -> Array:
    """Return the symmetric part of ``P``, which rounding may have left unsymmetric."""
    return symmetric(P)


def weighed(S: Array, z: Array) -> Array:
    """Return z' S^-1 z (...,), infinite where ``S`` (..., k, k) is not positive definite."""
    L = factor(S)
    squares = squared(whitened(L, z))
    return np.where(np.isfinite(L).all(axis=(-2, -1)), squares, np.inf)


def squared(z: Array) -> Array:
    """Return z' z (...,)."""
    return np.asarray(np.einsum('...i,...i->...', z, z))


def log_determinant(L: Array) -> Array:
    """Return log det S (...,) from its `factor`."""
    diagonal = np.diagonal(L, axis1=-2, axis2=-1)
    return np.asarray(2.0 * np.log(diagonal).sum(axis=-1))
