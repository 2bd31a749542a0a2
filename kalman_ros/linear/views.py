# SPDX-License-Identifier: Apache-2.0
"""Stacks of vectors and matrices with the stack in front, or behind: views of the same memory.

`numpy.moveaxis` does the same, and takes ten times as long.
"""

from __future__ import annotations

import numpy as np

from .matrices import Array


def coordinates(x: Array) -> Array:
    """Return the coordinates (n, ...) of vectors (..., n), each (...,), to be unpacked."""
    return np.asanyarray(x.transpose(x.ndim - 1, *range(x.ndim - 1)))


def coordinates_last(x: Array) -> Array:
    """Return the vectors (..., n) with coordinates (n, ...)."""
    if x.ndim == 1:
        return x
    return np.asanyarray(x.transpose(*range(1, x.ndim), 0))


def from_coordinates(*values: Array) -> Array:
    """Return the vectors (..., n) with these coordinates, each (...,).

    Each coordinate is contiguous in memory, which is what a model computes with.
    """
    return coordinates_last(np.array(values))


def entries_first(A: Array) -> Array:
    """Return the entries (n, m, ...) of matrices (..., n, m)."""
    return np.asanyarray(A.transpose(A.ndim - 2, A.ndim - 1, *range(A.ndim - 2)))


def entries_last(A: Array) -> Array:
    """Return the matrices (..., n, m) with entries (n, m, ...)."""
    return np.asanyarray(A.transpose(*range(2, A.ndim), 0, 1))
