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

    A function that accepts leading axes, or that returns the same for all x, is called once;
    else once for each vector. Which it is, is found by trying.
    """
    points = probes(n)
    single = [np.asarray(function(x)) for x in points]
    try:
        together = np.asarray(function(points))
        same = single[0].shape == together.shape and all(
            np.array_equal(each, together) for each in single
        )
        if same or (together.shape[0] == _PROBES and np.allclose(together, single)):
            return function
    except Exception:  # a function for one vector may fail on others in any way
        pass

    def each(x: Array) -> Array:
        found = [function(row) for row in x.reshape(-1, n)]
        return np.array(found).reshape(*x.shape[:-1], *single[0].shape)

    return each


def probes(n: int) -> Array:
    """Return points (3, n) without symmetry."""
    return np.random.default_rng(0).uniform(0.5, 1.5, (_PROBES, n))


def merged(objects: Sequence[T]) -> T | None:
    """Return one object whose numbers are arrays (p,) of those of p objects; None if impossible.

    A formula that accepts leading axes then computes with the parameters of all p at once, on
    vectors (..., p, n). Whether it does is for the caller to compare. An object with a method
    ``merged_numbers`` knows itself.
    """
    first: Any = objects[0]
    if hasattr(first, 'merged_numbers'):
        whole: T | None = first.merged_numbers(objects[1:])
        return whole
    if any(type(each) is not type(first) for each in objects):
        return None
    whole = copy(first)
    for name in vars(first):
        try:
            vars(whole)[name] = _merged_values([vars(each)[name] for each in objects])
        except (KeyError, TypeError, ValueError):
            return None
    return whole


def _merged_values(values: Sequence[Any]) -> Any:
    first = values[0]
    if isinstance(first, (float, int, np.ndarray)) and not isinstance(first, bool):
        arrays = [np.asarray(each) for each in values]
        if all(np.array_equal(each, arrays[0]) for each in arrays):
            return first
        return np.stack(arrays)
    if isinstance(first, tuple) and all(isinstance(each, float) for each in first):
        return tuple(_merged_values(each) for each in zip(*values, strict=True))
    if all(each is first or each == first for each in values):
        return first
    raise ValueError('it differs, and is no number')
