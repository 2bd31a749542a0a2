# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a vector mean: names, units, and which of them are angles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from kalman_ros.linear.matrices import Array


@dataclass(frozen=True)
class Space:
    """The coordinates of a state, an input or a reading.

    Differences and means of vectors use the space, so that an angle near +pi and one
    near -pi are close everywhere and callers need no special case for angles.

    Parameters
    ----------
    names
        One name a coordinate, unique; in one string, they are separated by spaces.
    units
        One unit a coordinate, in SI (``'m'``, ``'m/s'``, ``'rad'``); ``''`` for a pure number,
        as by default they all are.
    angles
        The names of the coordinates that wrap at +-pi.

    Raises
    ------
    ValueError
        If names repeat, units do not match them, or an angle is not among them.
    """

    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()
    _wrapped: Array | None = field(init=False, repr=False, compare=False, default=None)

    def __post_init__(self) -> None:
        for attribute in ('names', 'units', 'angles'):
            value = getattr(self, attribute)
            value = tuple(value.split() if isinstance(value, str) else value)
            object.__setattr__(self, attribute, value)
        object.__setattr__(self, 'units', self.units or ('',) * len(self.names))
        if len(set(self.names)) != len(self.names):
            raise ValueError(f'names: expected unique names, got {self.names}')
        if len(self.units) != len(self.names):
            raise ValueError(f'units: expected {len(self.names)} units, got {self.units}')
        self.indices(self.angles, 'angles')
        if self.angles:
            mask = np.array([name in self.angles for name in self.names])
            object.__setattr__(self, '_wrapped', mask)

    def __str__(self) -> str:
        return ', '.join(map(self.label, self.names)) or 'none'

    @property
    def size(self) -> int:
        """The number of coordinates."""
        return len(self.names)

    def indices(self, names: Iterable[str], argument: str = 'names') -> list[int]:
        """Return the position of each of ``names``.

        Raises
        ------
        ValueError
            If one is unknown; the message names the ``argument``.
        """
        found = []
        for name in names:
            if name not in self.names:
                known = ', '.join(self.names)
                raise ValueError(f"{argument}: expected names among ({known}), got '{name}'")
            found.append(self.names.index(name))
        return found

    def select(self, names: Iterable[str]) -> Space:
        """Return the space of some of the coordinates, in the order of ``names``."""
        names = tuple(names)
        units = tuple(self.units[index] for index in self.indices(names))
        return Space(names, units, tuple(name for name in names if name in self.angles))

    def wrap(self, x: Array) -> Array:
        """Return ``x`` (..., n) with every angle in [-pi, pi)."""
        if self._wrapped is None:
            return x
        return np.where(self._wrapped, (x + np.pi) % (2.0 * np.pi) - np.pi, x)

    def subtract(self, a: Array, b: Array) -> Array:
        """Return the shortest difference ``a - b`` (..., n)."""
        return a - b if self._wrapped is None else self.wrap(a - b)

    def mean(self, points: Array, weights: Array) -> Array:
        """Return the weighted mean (..., n) of ``points`` (k, ..., n); angles as directions.

        The mean of an angle is the direction of the weighted sum of unit vectors (Mardia and
        Jupp, Directional Statistics, section 2.2).
        """
        mean = _weighted(weights, points)
        if self._wrapped is None:
            return mean
        direction = np.arctan2(
            _weighted(weights, np.sin(points)), _weighted(weights, np.cos(points))
        )
        return np.where(self._wrapped, direction, mean)

    def label(self, name: str) -> str:
        """Return ``'name [unit]'``, for the axis of a plot or the head of a column."""
        unit = self.units[self.names.index(name)]
        return f'{name} [{unit}]' if unit else name


def _weighted(weights: Array, points: Array) -> Array:
    """Return the weighted sum (..., n) of ``points`` (k, ..., n)."""
    return weights.dot(points) if points.ndim == 2 else np.tensordot(weights, points, axes=1)
