# SPDX-License-Identifier: Apache-2.0
"""Validation of vectors and matrices, where things are built (never in inner loops).

Every function takes the argument's name first, for the error message.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import hypot, inf, isfinite, sqrt
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from .errors import DesignError

Array = npt.NDArray[np.float64]
ArrayLike = Union[npt.ArrayLike, Sequence[float], Sequence[Sequence[float]]]

#: An eigenvalue this far below zero, relative to the largest, is rounding.
_ROUNDING = 1e-10
#: Longest vector for which numbers of Python are faster than a dot product.
_FEW = 16
#: Numbers from which on a square is infinite.
_LARGEST_ROOT = sqrt(float(np.finfo(float).max))
#: Length of a dot product from which on BLAS may divide it among threads.
_THREADED = 8192
#: Sums of larger numbers may be infinite, and such a matrix has no eigenvalues.
_LARGEST = 1e300

#: Kinds of numpy's types that are no real numbers, in words.
_UNREAL = {'c': 'complex ones', 'm': 'durations', 'M': 'dates'}
#: As an array, since numpy would convert a number at every call.
_HALF = np.array(0.5)


def check_real(name: str, value: Any, *, dates: bool = False) -> None:
    """Raise ValueError for what numpy would make real numbers of without a word.

    These are complex numbers, whose imaginary parts it drops, and dates.
    """
    try:
        kind = np.asarray(value).dtype.kind
    except (TypeError, ValueError):  # rows of different lengths, which the caller refuses
        return
    if kind in _UNREAL and not (dates and kind in 'mM'):
        raise ValueError(f'{name}: expected real numbers, got {_UNREAL[kind]}')


def _finite(name: str, value: ArrayLike, *, unbounded: bool = False) -> Array:
    check_real(name, value)
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f'{name}: expected numbers, got {value!r}') from None
    if not np.all(np.isfinite(array) | (np.isposinf(array) & unbounded)):
        raise ValueError(f'{name}: expected finite numbers, got {array.tolist()}')
    return array


def vector(
    name: str, value: ArrayLike, size: int | None = None, *, unbounded: bool = False
) -> Array:
    """Return ``value`` as a finite vector (size,), or raise ValueError.

    If it is ``unbounded``, numbers may be infinite, and positive.
    """
    array = _finite(name, value, unbounded=unbounded)
    if array.ndim != 1:
        raise ValueError(f'{name}: expected a vector, got an array of shape {array.shape}')
    if size is not None and array.size != size:
        raise ValueError(f'{name}: expected {size} numbers, got {array.size}')
    return array


def one_each(name: str, values: ArrayLike, size: int) -> Array:
    """Return ``size`` numbers; one is repeated, and infinite ones are allowed."""
    check_real(name, values)
    try:
        array = np.asarray(values, dtype=float).ravel()
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f'{name}: expected numbers, got {values!r}') from None
    if np.isnan(array).any():
        raise ValueError(f'{name}: expected numbers, got {array.tolist()}')
    if array.size not in (1, size):
        wanted = '1 number' if size == 1 else f'1 or {size} numbers'
        raise ValueError(f'{name}: expected {wanted}, got {array.size}')
    return np.broadcast_to(array, size)


def matrix(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    """Return ``value`` as a finite matrix of ``shape``; a flat row-major list is accepted."""
    array = _finite(name, value)
    if array.ndim == 1 and array.size == shape[0] * shape[1]:
        array = array.reshape(shape)
    if array.shape != shape:
        got = f'{array.size} numbers' if array.ndim == 1 else f'shape {array.shape}'
        raise ValueError(
            f'{name}: expected {shape[0]} x {shape[1]} = {shape[0] * shape[1]} numbers, got {got}'
        )
    return array


def symmetric(P: Array) -> Array:
    """Return the symmetric part of ``P`` (..., n, n)."""
    # a copy, since adding a transposed view takes three times as long
    half: Array = P.swapaxes(-1, -2).copy()
    half += P
    half *= _HALF
    return half


def is_finite(values: Array) -> bool:
    """Return whether all ``values`` are finite, and none so large that its square is not.

    A third of the time of ``np.isfinite(values).all()``.
    """
    if values.ndim == 1 and values.size <= _FEW:
        return bool(hypot(*values.tolist()) < _LARGEST_ROOT)
    flat = values.ravel('K')  # in memory order
    # a longer dot product has threads, which wait for a busy processor
    # vdot, since dot warns of an overflow
    return isfinite(np.vdot(flat, flat) if flat.size < _THREADED else np.einsum('i,i', flat, flat))


@lru_cache(maxsize=64)
def identity(n: int) -> Array:
    """Return the identity (n, n), a shared read-only array."""
    eye = np.eye(n, order='F')
    eye.flags.writeable = False
    return eye


def solve(A: Array, B: Array) -> Array:
    """Return A^-1 B (n, k) for a square ``A`` (n, n); LinAlgError if it is singular."""
    return np.asarray(np.linalg.solve(A, B), dtype=float)


def semidefinite(name: str, value: ArrayLike, size: int, *, definite: bool = False) -> Array:
    """Return a symmetric positive (semi-)definite matrix (size, size), or raise ValueError.

    ``size`` numbers are the diagonal, ``size * size`` are the whole matrix, row by row.
    """
    array = _finite(name, value)
    if array.ndim == 1 and array.size == size:
        array = np.diag(array)
    elif array.size == size * size and array.ndim in (1, 2):
        array = array.reshape(size, size)
    else:
        options = f'{size} numbers (the diagonal) or {size * size} (the matrix, row by row)'
        raise ValueError(f'{name}: expected {options}, got {array.size}')
    largest = float(np.abs(array).max(initial=0.0))
    if largest > _LARGEST:
        raise ValueError(f'{name}: expected numbers of at most {_LARGEST:g}, got {largest:g}')
    if not np.allclose(array, array.T, rtol=0.0, atol=1e-9 * largest):
        raise ValueError(f'{name}: expected a symmetric matrix, got {array.tolist()}')
    array = symmetric(array)
    smallest = min(np.linalg.eigvalsh(array).tolist(), default=inf)
    if smallest < -_ROUNDING * largest or (definite and smallest <= 0.0):
        kind = 'definite' if definite else 'semi-definite'
        raise DesignError(
            f'{name}: expected a positive {kind} matrix, its smallest eigenvalue is {smallest:.3g}'
        )
    return array


def variances(
    name: str, deviations: ArrayLike, size: int, *, exact: bool = False, unknown: bool = False
) -> Array:
    """Return the diagonal covariance (size, size) of positive standard ``deviations``.

    A zero deviation is refused unless it may be ``exact``: no measurement is, but a robot may
    know where it starts. An infinite one is refused unless a state may be ``unknown``.
    """
    sigma = vector(name, deviations, size, unbounded=unknown)
    if not np.all(sigma >= 0.0 if exact else sigma > 0.0):
        kind = 'zero or positive' if exact else 'positive'
        raise ValueError(f'{name}: expected {kind} standard deviations, got {sigma.tolist()}')
    with np.errstate(over='ignore', under='ignore'):
        squares = sigma**2
    sound = np.isfinite(squares) | np.isinf(sigma)
    if not (sound & ((squares > 0.0) | (sigma == 0.0))).all():
        raise ValueError(f'{name}: the square of a number is not finite and positive, got {sigma}')
    return np.diag(squares)


def spectral_densities(size: int, **named: ArrayLike) -> Array:
    """Return vectors (size,) of densities that are zero or positive, one after the other."""
    densities = [vector(name, values, size) for name, values in named.items()]
    for name, values in zip(named, densities):
        if not np.all(values >= 0.0):
            raise ValueError(
                f'{name}: expected spectral densities, zero or positive, got {values.tolist()}'
            )
    return np.concatenate(densities)
