# SPDX-License-Identifier: Apache-2.0
"""Spaces with rotations whose differences are compiled C."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space

from .derived import derive
from .formulas import of_space
from .library import load
from .numbered import POINTER, address, hold, memory
from .source import source


class NativeSpace(Space):
    """A space with rotations whose differences are compiled, equal to the same one without."""

    _c_arrive: Callable[[int], None]
    _c_subtract: Callable[[int], None]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Space) and _fields(self) == _fields(other)

    __hash__ = Space.__hash__

    def arrived(self, total: Array, origin: Array, P: Array) -> tuple[Array, Array]:
        """Return mean and covariance of an error that moves its origin to its own mean."""
        n = self.size
        if not (n,) == total.shape == origin.shape == P.shape[1:] or P.shape[0] != n:
            return super().arrived(total, origin, P)
        mean, end = 2 * n + n * n, 3 * n + n * n
        v = np.empty(end + n * n)
        v[:n], v[n : 2 * n], v[2 * n : mean] = total, origin, P.ravel()
        self._c_arrive(address(memory(v)))
        return v[mean:end], v[end:].reshape(n, n)

    def subtract(self, a: Array, b: Array) -> Array:
        """Return the shortest difference ``a - b`` (..., n); of rotations, Log(Exp(a) Exp(-b))."""
        n = self.size
        if not (n,) == a.shape == b.shape:
            return super().subtract(a, b)
        v = np.empty(3 * n)
        v[:n], v[n : 2 * n] = a, b
        self._c_subtract(address(memory(v)))
        return v[2 * n :]


def _fields(space: Space) -> tuple[Any, ...]:
    return space.names, space.units, space.angles, space.rotations


def native_space(space: Space, *, wait: bool = True) -> Space:
    """Return a space with compiled differences; one without rotations is as fast as it is."""
    if not space.rotations or isinstance(space, NativeSpace):
        return space
    library = load(_space_source(space), wait=wait)
    for name in ('arrive', 'subtract'):
        hold(library, name, None, POINTER)
    derived: Space = derive(
        NativeSpace, space, native_space, _c_arrive=library.arrive, _c_subtract=library.subtract
    )
    return derived


@lru_cache(maxsize=32)
def _space_source(space: Space) -> str:
    return source(['space.c'], {'N': space.size}, of_space(space)._asdict(), {})
