# SPDX-License-Identifier: Apache-2.0
"""Functions of one vector, applied to arrays of vectors; and several models as one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from typing import Any, TypeVar

import numpy as np

from kalman_ros.linear.matrices import Array

T = TypeVar('T')
#: Points at which functions are compared; three, which is the size of nothing else that matters.
_PROBES = 3


def vectorized(function: Callable[[Array], Array], n: int) -> Callable[[Array], Array]:
    """Return a function of x (..., n) for one of x (n,) whose result is a matrix.

    A function that accepts leading axes, or that returns the same for all x, is called once; any
    other function is called once for each vector. The kind is determined by trying.
    """
    points = probes(n)
    single = [np.asarray(function(x)) for x in points]
    try:
        together = np.asarray(function(points))
        same = single[0].shape == together.shape and all(
            np.array_equal(value, together) for value in single
        )
        if same or (together.shape[0] == _PROBES and np.allclose(together, single)):
            return function
    except Exception:  # a function for one vector may fail on others in any way
        pass

    def by_row(x: Array) -> Array:
        results = [function(row) for row in x.reshape(-1, n)]
        return np.array(results).reshape(*x.shape[:-1], *single[0].shape)

    return by_row


def probes(n: int) -> Array:
    """Return points (3, n) without symmetry."""
    return np.random.default_rng(0).uniform(0.5, 1.5, (_PROBES, n))


def merged(objects: Sequence[T]) -> T | None:
    """Return one object whose numbers are arrays (p,) of those of p objects; None if impossible.

    A formula that accepts leading axes then computes with the parameters of all p at once, on
    vectors (..., p, n). The caller has to compare whether it does. An object may define
    ``merged_numbers`` for this.
    """
    first: Any = objects[0]
    if hasattr(first, 'merged_numbers'):
        whole: T | None = first.merged_numbers(objects[1:])
        return whole
    if any(type(item) is not type(first) for item in objects):
        return None
    whole = copy(first)
    for name in vars(first):
        try:
            vars(whole)[name] = _merged_values([vars(item)[name] for item in objects])
        except (KeyError, TypeError, ValueError):
            return None
    return whole


def _merged_values(values: Sequence[Any]) -> Any:
    first = values[0]
    if isinstance(first, (float, int, np.ndarray)) and not isinstance(first, bool):
        arrays = [np.asarray(value) for value in values]
        if all(np.array_equal(array, arrays[0]) for array in arrays):
            return first
        return np.stack(arrays)
    if isinstance(first, tuple) and all(isinstance(value, float) for value in first):
        return tuple(_merged_values(column) for column in zip(*values, strict=True))
    if all(value is first or value == first for value in values):
        return first
    raise ValueError('it differs, and is no number')
