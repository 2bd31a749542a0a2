# SPDX-License-Identifier: Apache-2.0
"""Polynomials over a box of parameters, and the hull of their values.

A function of d parameters is taken as the polynomial of second degree in each of them through its
values at the corners, the middles of the sides and the centre of a box. Values of a polynomial lie
in the hull of its Bernstein coefficients (J. Garloff, The Bernstein Algorithm, Interval
Computations 2, 1993).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from math import comb

import numpy as np

from .matrices import Array

#: The largest degree in each parameter of polynomials whose coefficients are computed.
DEGREE = 5
#: Where a cubic differs most from its parabola, as a part of half the side of a box.
_LARGEST = 3.0**-0.5


def polynomial(matrices: Callable[[Array], Array], low: Array, high: Array) -> tuple[Array, Array]:
    """Return the matrices of a box, and by how much others differ from their polynomial.

    Returns
    -------
    grid
        Matrices (3, ..., 3, k) at the corners, middles of the sides, and the centre.
    rest
        Differences (K, k) at the points at which that of a cubic is largest.
    """
    d, middle, half = len(low), 0.5 * (low + high), 0.5 * (high - low)
    around = np.array(list(product((-1.0, 0.0, 1.0), repeat=d)))
    grid, inner = (
        np.array([matrices(np.clip(middle + half * part * at, low, high)) for at in around])
        for part in (1.0, _LARGEST)
    )
    grid = grid.reshape(*(3,) * d, -1)
    t = 0.5 + 0.5 * _LARGEST * np.array([-1.0, 0.0, 1.0])
    return grid, inner - _along_axes(_quadratic(t), grid, d)


def centre(grid: Array, d: int) -> Array:
    """Return the value in the middle of a box."""
    return np.asarray(grid[(1,) * d])


def slopes(grid: Array, d: int) -> Array:
    """Return half the differences (d, ...) between opposite sides of a box."""
    middle = [1] * d
    ends = [[(*middle[:axis], end, *middle[axis + 1 :]) for end in (0, 2)] for axis in range(d)]
    return np.array([0.5 * (grid[high] - grid[low]) for low, high in ends])


def at_nodes(grid: Array, d: int) -> Array:
    """Return at equidistant nodes (N, ...) the polynomial through the points of a grid."""
    t = np.linspace(0.0, 1.0, DEGREE + 1)
    return _along_axes(_quadratic(t), grid, d)


def coefficients(values: Array, d: int) -> Array:
    """Return the Bernstein coefficients (N, ...) of a polynomial with values at nodes (N, ...)."""
    t = np.linspace(0.0, 1.0, DEGREE + 1)
    basis = np.stack(
        [comb(DEGREE, k) * t**k * (1.0 - t) ** (DEGREE - k) for k in range(DEGREE + 1)], 1
    )
    grid = values.reshape(*(len(t),) * d, *values.shape[1:])
    return _along_axes(np.asarray(np.linalg.inv(basis), dtype=float), grid, d)


def _quadratic(t: Array) -> Array:
    """Return the values at t (N,) of the polynomials that are 1 at one of 0, 1/2, 1 (N, 3)."""
    return np.stack(((1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)), 1)


def _along_axes(matrix: Array, values: Array, d: int) -> Array:
    """Return values (N, ...) after a matrix along each of the first ``d`` axes."""
    for axis in range(d):
        values = np.moveaxis(np.tensordot(matrix, values, (1, axis)), 0, axis)
    return np.asarray(values).reshape(-1, *values.shape[d:])
