# SPDX-License-Identifier: Apache-2.0
"""Recursions over the readings of a pass, in C where there is a compiler."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from functools import lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.linear.matrices import Array, symmetric

from .library import HEAD, CompilerError, load
from .parts import NUMPY, VARIABLE

_POINTER, _LONG = ctypes.c_void_p, ctypes.c_long


class Rows(NamedTuple):
    """The readings of a pass in their order, with a row for each of their R numbers.

    Parameters
    ----------
    F
        Step to each of the E readings (E, n, n).
    sizes, first
        Numbers of each reading (E,), and its first row.
    H, K
        Jacobian and transposed gain (R, n).
    white, innovation
        Matrices (R, m) that whiten, and the whitened innovations (R,).
    """

    F: Array
    sizes: Any
    first: Any
    H: Array
    K: Array
    white: Array
    innovation: Array

    def between(self, begin: int, end: int) -> Rows:
        """Return some of the readings."""
        start = int(self.first[begin])
        rows = slice(start, int(self.first[end - 1] + self.sizes[end - 1]))
        arrays = (self.H, self.K, self.white, self.innovation)
        at = slice(begin, end)
        return Rows(
            self.F[at],
            self.sizes[at],
            self.first[at] - start,
            *(values[rows] for values in arrays),
        )


def respond(rows: Rows, added: Array, first: int, error: Array, Z: Array) -> None:
    """Let faults of unit size act on readings.

    Parameters
    ----------
    rows
        Readings.
    added, first
        What the step to each reading adds to the errors by q faults (E, n, q), and the first of
        these.
    error
        Mean error (n, p) of the state by each fault before the first reading; receives that
        after the last one.
    Z
        What each fault changes in the readings alone (R, p); receives the change of the whitened
        innovations.
    """
    library = _library() if os.environ.get(VARIABLE) != NUMPY else None
    if library is not None:
        room = np.empty(error.shape)
        library.respond(
            len(rows.F), *error.shape,
            *map(_at, (rows.F, rows.sizes, rows.H, rows.K, rows.white)), rows.white.shape[1],
            first, added.shape[2], *map(_at, (added, error, room, Z)),
        )  # fmt: skip
        return
    last = first + added.shape[2]
    for F, k, row, more in zip(rows.F, rows.sizes.tolist(), rows.first.tolist(), added):
        error[:] = F.dot(error)
        error[:, first:last] += more
        at = slice(row, row + k)
        response = Z[at] + rows.H[at].dot(error)
        error -= rows.K[at].T.dot(response)
        Z[at] = rows.white[at, :k].dot(response)


class Errors(NamedTuple):
    """Innovations that read an error of n numbers, and its steps from one to the next.

    Parameters
    ----------
    F, Q
        Step to each of the E innovations (E, n, n), and its noise covariance.
    sizes, first
        Numbers of each innovation (E,), and its first row.
    H, R, innovation
        Jacobian (R, n), rows of noise covariances (R, m), and the innovations (R,).
    moved
        What is taken from the error after each innovation (E, n).
    """

    F: Array
    Q: Array
    sizes: Any
    first: Any
    H: Array
    R: Array
    innovation: Array
    moved: Array


def follow(errors: Errors, covariance: Array, beliefs: tuple[Array, Array] | None = None) -> float:
    """Return the misfit of a Kalman filter of an error, -2 log likelihood.

    Parameters
    ----------
    errors
        Innovations.
    covariance
        Covariance (n, n) of the error at the first one, with a mean of zero.
    beliefs
        Arrays that receive the mean (E, n) and the covariance (E, n, n) after each innovation.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is not positive definite.
    """
    n, m = errors.H.shape[1], errors.R.shape[1]
    x, P = np.zeros(n), covariance.copy()
    library = _library() if os.environ.get(VARIABLE) != NUMPY else None
    if library is not None:
        room = np.empty(m * m + m + m * n + n + 2 * n * n)
        given = (errors.H, errors.R)
        misfit = library.follow(
            len(errors.F), n, *map(_at, (errors.F, errors.Q, errors.sizes, *given)), m,
            *map(_at, (errors.innovation, errors.moved, x, P)),
            *((None, None) if beliefs is None else map(_at, beliefs)), _at(room),
        )  # fmt: skip
    else:
        misfit = sum(_followed(errors, x, P, beliefs))
    if not np.isfinite(misfit):
        raise np.linalg.LinAlgError('no covariance of innovations is positive definite')
    return float(misfit)


def _followed(
    errors: Errors, x: Array, P: Array, beliefs: tuple[Array, Array] | None
) -> Iterator[float]:
    """Yield the misfit of each innovation."""
    for i, (k, row) in enumerate(zip(errors.sizes.tolist(), errors.first.tolist())):
        if i:
            F = errors.F[i]
            x, P = F.dot(x - errors.moved[i - 1]), symmetric(F.dot(P).dot(F.T) + errors.Q[i])
        at = slice(row, row + k)
        H = errors.H[at]
        PH = P.dot(H.T)
        L = np.linalg.cholesky(H.dot(PH) + errors.R[at, :k])
        e, W = np.linalg.solve(L, errors.innovation[at] - H.dot(x)), np.linalg.solve(L, PH.T)
        x, P = x + W.T.dot(e), P - W.T.dot(W)
        if beliefs is not None:
            beliefs[0][i], beliefs[1][i] = x, P
        yield float(e.dot(e) + 2.0 * np.log(L.diagonal()).sum() + k * np.log(2.0 * np.pi))


def _at(values: Any) -> int:
    """Return the address of contiguous numbers, which their owner keeps."""
    assert values.flags.c_contiguous
    return int(values.ctypes.data)


@lru_cache(maxsize=1)
def _library() -> Any:
    """Return the functions in C; None without a compiler."""
    try:
        library = load(HEAD + files(__package__).joinpath('recursions.c').read_text())
    except CompilerError:
        return None
    library.respond.argtypes = [
        *[_LONG] * 3, *[_POINTER] * 5, *[_LONG] * 3, *[_POINTER] * 4
    ]  # fmt: skip
    library.respond.restype = None
    library.follow.argtypes = [
        *[_LONG] * 2, *[_POINTER] * 5, _LONG, *[_POINTER] * 7
    ]  # fmt: skip
    library.follow.restype = ctypes.c_double
    return library
