# SPDX-License-Identifier: Apache-2.0
"""Meaning of the numbers of a vector: names, units, angles and rotations."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from kalman_ros.linear.matrices import Array

from . import rotations as so3


@dataclass(frozen=True)
class Space:
    """The coordinates of a state, an input or a reading.

    Sums, differences and means of vectors use the space, so that an angle near +pi and one
    near -pi are close everywhere and callers need no special case for angles and rotations.

    A rotation is three numbers, its rotation vector r. Its difference from another one, r_0, is
    the rotation vector e of the error in the axes of the world, Exp(r) = Exp(e) Exp(r_0), a vector
    of the tangent space at r_0 (the left side). Covariances, Jacobians, rates of change and noise
    refer to such differences.

    Parameters
    ----------
    names
        One unique name for each coordinate; in one string, they are separated by spaces.
    units
        One unit for each coordinate, in SI (``'m'``, ``'m/s'``, ``'rad'``); ``''``, the default,
        for a pure number.
    angles
        Names of the coordinates that wrap at +-pi.
    rotations
        Names of the three coordinates of each rotation, which are neighbours in this order; in
        one string, they are separated by spaces.

    Raises
    ------
    ValueError
        If names repeat, units do not match them, an angle is not among them, or a rotation is not
        three neighbours.

    Examples
    --------
    >>> import numpy as np
    >>> import kalman_ros as kr
    >>> space = kr.Space(('x', 'psi'), ('m', 'rad'), angles=('psi',))
    >>> space.subtract(np.array([1.0, 3.0]), np.array([0.5, -3.0])).round(3)
    array([ 0.5  , -0.283])
    """

    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()
    rotations: tuple[tuple[str, ...], ...] = field(repr=False, default=())
    _wrapped: list[int] = field(init=False, repr=False, compare=False, default_factory=list)
    _turned: tuple[slice, ...] = field(init=False, repr=False, compare=False, default=())

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
        object.__setattr__(self, '_wrapped', self.indices(self.angles, 'angles'))
        triples = tuple(tuple(r.split() if isinstance(r, str) else r) for r in self.rotations)
        object.__setattr__(self, 'rotations', triples)
        object.__setattr__(self, '_turned', tuple(map(self._place, triples)))

    def _place(self, rotation: tuple[str, ...]) -> slice:
        """Return the slice of a rotation among the coordinates."""
        first, *others = self.indices(rotation, 'rotations') or [0]
        if others != [first + 1, first + 2] or {*rotation} & {*self.angles}:
            raise ValueError(
                'rotations: expected three neighbours that are no angles, '
                f'got ({", ".join(rotation)}) in ({", ".join(self.names)})'
            )
        return slice(first, first + 3)

    def __str__(self) -> str:
        return ', '.join(map(self.label, self.names)) or 'none'

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.names)

    def indices(self, names: Iterable[str], argument: str = 'names') -> list[int]:
        """Return the position of each of ``names``.

        Raises
        ------
        ValueError
            If a name is unknown; the message names the ``argument``.
        """
        positions = []
        for name in names:
            if name not in self.names:
                known = ', '.join(self.names)
                raise ValueError(f"{argument}: expected names among ({known}), got '{name}'")
            positions.append(self.names.index(name))
        return positions

    @property
    def turns(self) -> tuple[slice, ...]:
        """Positions of the angles, one coordinate each, and of the rotations, three each."""
        return (*(slice(index, index + 1) for index in self._wrapped), *self._turned)

    def rotation(self, names: Iterable[str], argument: str = 'measures') -> slice:
        """Return the position of the rotation with these names.

        Raises
        ------
        ValueError
            If they are not the names of a rotation; the message names the ``argument``.
        """
        names = tuple(names)
        if names not in self.rotations:
            known = (
                ' or '.join(f'({", ".join(rotation)})' for rotation in self.rotations) or 'none'
            )
            raise ValueError(
                f'{argument}: expected the names of a rotation, {known}, got ({", ".join(names)})'
            )
        return self._turned[self.rotations.index(names)]

    def select(self, names: Iterable[str]) -> Space:
        """Return the space of some of the coordinates, in the order of ``names``.

        Raises
        ------
        ValueError
            If a name is unknown, or a rotation is not selected whole and in its order.
        """
        names = tuple(names)
        units = tuple(self.units[index] for index in self.indices(names))
        whole = tuple(rotation for rotation in self.rotations if {*rotation} & {*names})
        try:
            return Space(names, units, tuple(n for n in names if n in self.angles), whole)
        except ValueError:
            if len({*names}) < len(names) or not whole:
                raise
            listed = ', '.join(f'({", ".join(rotation)})' for rotation in whole)
            raise ValueError(
                f'names: expected a rotation as a whole, {listed}, got ({", ".join(names)})'
            ) from None

    @property
    def tangent(self) -> Space:
        """Space of small differences, in which rotations are vectors."""
        return Space(self.names, self.units, self.angles) if self.rotations else self

    def wrap(self, x: Array) -> Array:
        """Return ``x`` (..., n) with angles in [-pi, pi), and rotations by at most pi."""
        if self._wrapped:
            x = 1.0 * x
            for index in self._wrapped:
                turned = x[..., index] + np.pi
                # of many, a remainder takes far longer than the question whether any changes
                if x.ndim == 1 or not (
                    turned.min(initial=0.0) >= 0.0 and turned.max(initial=0.0) < 2.0 * np.pi
                ):
                    turned = turned % (2.0 * np.pi)
                x[..., index] = turned - np.pi
        return self._map_rotations(so3.shortest, x) if self._turned else x

    def add(self, x: Array, d: Array) -> Array:
        """Return the retraction (..., n) of the difference ``d`` at ``x``, inverse of `subtract`.

        A rotation becomes Exp(d) Exp(x).
        """
        return self.wrap(self.reached(x + d, x))

    def reached(self, total: Array, origin: Array) -> Array:
        """Return the retraction (..., n) of ``total`` - ``origin`` at ``origin``.

        Unlike `add` it does not wrap angles, so that a caller may compute the sum ``total`` in its
        own way and wrap the result, or not.
        """
        if not self._turned:
            return total
        return self._map_rotations(lambda a, b: so3.compose(a - b, b), total, origin)

    def subtract(self, a: Array, b: Array) -> Array:
        """Return the shortest difference ``a - b`` (..., n); of rotations, Log(Exp(a) Exp(-b))."""
        if self._turned:
            difference = self._map_rotations(lambda p, q: so3.compose(p, -q), a, b, base=a - b)
        else:
            difference = a - b
        return self.wrap(difference) if self._wrapped else difference

    def _map_rotations(self, function: Any, *points: Array, base: Array | None = None) -> Array:
        """Return ``base``, with rotations replaced by a ``function`` of those of ``points``."""
        result: Array = (points[0] if base is None else base).copy()
        for place in self._turned:
            result[..., place] = function(*(p[..., place] for p in points))
        return result

    def jumps(self, x: Array) -> npt.NDArray[np.bool_]:
        """Return the mask (N, n) where a curve passes to other numbers of an angle or rotation."""
        step = np.abs(np.diff(x, axis=0, prepend=x[:1]))
        wrapped = [name in self.angles for name in self.names]
        mask: npt.NDArray[np.bool_] = (step > np.pi) & np.array(wrapped, dtype=bool)
        for place in self._turned:
            mask[:, place] = (np.linalg.norm(step[:, place], axis=-1) > np.pi)[:, np.newaxis]
        return mask

    def mean(self, points: Array, weights: Array) -> Array:
        """Return the weighted mean (..., n) of ``points`` (k, ..., n); angles as directions.

        The mean of an angle is the direction of the weighted sum of unit vectors (Mardia and
        Jupp, Directional Statistics, section 2.2); the mean error about that of rotations is 0.
        """
        mean = _weighted(weights, points)
        for place in self._turned:
            mean[..., place] = so3.mean(points[..., place], weights)
        if not self._wrapped:
            return mean
        direction = np.arctan2(
            _weighted(weights, np.sin(points)), _weighted(weights, np.cos(points))
        )
        mean[..., self._wrapped] = direction[..., self._wrapped]
        return mean

    def arrived(self, total: Array, origin: Array, P: Array) -> tuple[Array, Array]:
        """Return mean and covariance after a reset: the origin of an error moves to its mean.

        The error about ``origin`` (..., n) has the mean ``total`` - ``origin``, and the covariance
        ``P`` (..., n, n); about the new mean it has the covariance J P J', with J the left
        Jacobian of the rotation between the two (J. Sola, Quaternion kinematics for the
        error-state Kalman filter, arXiv:1711.02508, section 6.3).
        """
        if not self._turned:
            return self.wrap(total) if self._wrapped else total, P
        mean = self.wrap(self.reached(total, origin))
        return mean, self._congruent(P, total - origin, so3.left_jacobian)

    def from_afar(self, P: Array, d: Array) -> Array:
        """Transport a covariance (..., n, n) about a point ``d`` away (..., n) to the origin."""
        return self._congruent(P, d, so3.inverse_left_jacobian) if self._turned else P

    def slope_from_afar(self, d: Array) -> Array:
        """Return J (..., n, n), the slope of differences from the origin by those from ``d``.

        `from_afar` transports a covariance with it.
        """
        J: Array = np.broadcast_to(np.eye(self.size), (*d.shape, self.size)).copy()
        for place in self._turned:
            J[..., place, place] = so3.inverse_left_jacobian(d[..., place])
        return J

    def _congruent(self, P: Array, d: Array, jacobian: Callable[[Array], Array]) -> Array:
        """Return J P J', with J the ``jacobian`` of each rotation in d, and 1 for all else."""
        result = np.broadcast_to(P, (*d.shape, self.size)).copy()
        for place in self._turned:
            J = jacobian(d[..., place])
            result[..., place, :] = J @ result[..., place, :]
            result[..., place] = result[..., place] @ np.swapaxes(J, -1, -2)
        return np.asarray(0.5 * (result + np.swapaxes(result, -1, -2)))

    def pulled_back(self, d: Array, rate: Array) -> Array:
        """Return the rate (..., n) at which a difference ``d`` grows if its end moves at ``rate``.

        H. Munthe-Kaas, High order Runge-Kutta methods on manifolds, Applied Numerical Mathematics
        29(1), 1999, with which integrators stay on the group.
        """
        return self._map_rotations(so3.pulled_back, d, rate, base=rate) if self._turned else rate

    def of_errors(self, slope: Array, rate: Array) -> Array:
        """Return A (..., n, n) of e' = A e from the ``slope`` of the ``rate`` (..., n) by e.

        A rotation turns its errors with it: A = slope + [rate]x, the adjoint of equation 143 in
        the source of `rotations`.
        """
        if not self._turned:
            return slope
        A: Array = slope.copy()
        for place in self._turned:
            A[..., place, place] += so3.skew(rate[..., place])
        return A

    def label(self, name: str) -> str:
        """Return ``'name [unit]'``, for the axis of a plot or the head of a column."""
        unit = self.units[self.names.index(name)]
        return f'{name} [{unit}]' if unit else name


def no_rotation(state: Space) -> None:
    """Raise ValueError if a state has rotations, where only vectors can be."""
    if state.rotations:
        listed = ', '.join(state.rotations[0])
        raise ValueError(f'state: expected no rotation in a linear model, got ({listed})')


def _weighted(weights: Array, points: Array) -> Array:
    """Return the weighted sum (..., n) of ``points`` (k, ..., n)."""
    return weights.dot(points) if points.ndim == 2 else np.tensordot(weights, points, axes=1)
