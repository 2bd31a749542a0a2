# SPDX-License-Identifier: Apache-2.0
"""Conversion of user input to matrices, spaces and systems."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.control.operating_point import is_still, unrest
from kalman_ros.core import (
    Array,
    ArrayLike,
    Dynamics,
    Gaussian,
    LinearSystem,
    Space,
    brief,
    check_real,
    linearize,
    matrix,
    semidefinite,
    vector,
)

from .foreign import is_foreign, labels_of, read_system

#: A first belief that knows nothing.
DIFFUSE = 'diffuse'


def square(name: str, value: ArrayLike | None) -> Array:
    """Return a square matrix (n, n); a number is a matrix (1, 1)."""
    array = numbers(name, value)
    array = np.atleast_2d(array) if array.ndim == 0 else array
    if array.ndim != 2 or array.shape[0] != array.shape[1]:
        raise ValueError(f'{name}: expected a square matrix, got {_shape(array)}')
    if not array.size:
        raise ValueError(f'{name}: expected at least one state, got none')
    return matrix(name, array, (len(array), len(array)))


def columns(name: str, value: ArrayLike | None, n: int) -> Array:
    """Return a matrix (n, m), such as B; n numbers are one column."""
    array = numbers(name, value)
    array = array.reshape(-1, 1) if array.ndim <= 1 else array
    if array.ndim != 2 or len(array) != n:
        raise ValueError(f'{name}: expected {n} rows, one a state, got {_shape(array)}')
    return matrix(name, array, (n, array.shape[1]))


def rows(name: str, value: ArrayLike | None, n: int) -> Array:
    """Return a matrix (k, n), such as C; n numbers are one row."""
    array = numbers(name, value)
    array = array.reshape(1, -1) if array.ndim <= 1 else array
    if array.ndim != 2 or array.shape[1] != n:
        raise ValueError(f'{name}: expected {n} columns, one a state, got {_shape(array)}')
    return matrix(name, array, (len(array), n))


def weight(name: str, value: ArrayLike | None, size: int, *, definite: bool = False) -> Array:
    """Return a symmetric matrix (size, size): a cost, a covariance or a density.

    A number stands for that number times the identity, ``size`` numbers for the diagonal.
    """
    array = numbers(name, value)
    if array.ndim == 0:
        array = np.full(size, float(array))
    if array.shape not in ((size,), (size, size), (size * size,)):
        raise ValueError(
            f'{name}: expected a {size} x {size} matrix, its diagonal or one number, '
            f'got {_shape(array)}'
        )
    return semidefinite(name, array, size, definite=definite)


def numbers(name: str, value: Any) -> Array:
    """Return numbers of any shape."""
    if value is None:
        raise ValueError(f'{name}: expected numbers, got nothing')
    check_real(name, value)
    try:
        return np.asarray(filled(value), dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f'{name}: expected real numbers, in rows of one length, got {got(value)}'
        ) from None


def filled(value: Any) -> Any:
    """Return what is no masked array as it is, and of one the numbers, with NaN where masked."""
    return np.ma.filled(value.astype(float), np.nan) if np.ma.is_masked(value) else value


def limits_given(
    limit: ArrayLike | None, lower: ArrayLike | None, rate: ArrayLike | None
) -> dict[str, Array]:
    """Return the limits of the input that are given, by name."""
    given = {'input_limit': limit, 'input_lower_limit': lower, 'input_rate_limit': rate}
    return {name: numbers(name, value) for name, value in given.items() if value is not None}


def got(value: Any) -> str:
    """Return a few words for a wrong value, as an error quotes it."""
    if value is None:
        return 'nothing'
    if isinstance(value, type):
        return f'the class {value.__name__} and not an object of it'
    if isinstance(value, (str, int, float, complex, list, tuple)):
        return ' '.join(brief(value).split())
    return type(value).__name__


def _shape(array: Array) -> str:
    return f'shape {array.shape}' if array.ndim else f'the number {array}'


#: A name and its unit in one string of several, and the unit at the end of a single name.
_NAME = re.compile(r'\S+(?:\s+\[[^\]]*\])?')
_UNIT = re.compile(r'\s+\[(.*)\]$')


def space(
    what: str, names: int | str | Sequence[str], prefix: str, angles: Sequence[str] = ()
) -> Space:
    """Return a space of named coordinates, or of N, called x0, x1, ... by a ``prefix``.

    A name may include its unit, ``'x [m]'``, also among several in one string.
    """
    if isinstance(names, str):
        names = _NAME.findall(names)
    elif isinstance(names, (int, np.integer)):
        names = [f'{prefix}{index}' for index in range(names)]
    try:
        parts = [_UNIT.split(str(name)) for name in names]
        units = tuple(''.join(part[1:2]) for part in parts)
        return Space(tuple(part[0] for part in parts), units, tuple(angles))
    except (TypeError, ValueError) as error:
        raise ValueError(f'{what}: {error}') from None


@dataclass(frozen=True)
class Plant:
    """A linear system: A and B of dx/dt, or F and G in samples of ``dt``; and its names."""

    A: Array
    B: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    dt: float | None = None

    @property
    def system(self) -> LinearSystem:
        """The same system in continuous time, without noise."""
        n, m = self.B.shape
        spaces = Space(self.states, ('',) * n), Space(self.inputs, ('',) * m)
        return LinearSystem(self.A, self.B, np.zeros((n, n)), *spaces)


def is_system(value: Any) -> bool:
    """Return whether ``value`` is a whole system: a model, or one of another library."""
    return isinstance(value, Dynamics) or is_foreign(value)


def plant(A: Any, B: Any = None) -> Plant:
    """Return the system of two matrices, a model about its equilibrium, or another library.

    Raises
    ------
    ValueError
        If it is none of these, or sizes do not match.
    """
    if isinstance(A, Dynamics):
        model: Any = A
        names = model.state.names, model.input.names
        check_still('A', model)
        if model.is_discrete:
            F, G = model.next_jacobian(*model.equilibrium)
            return Plant(F, G, *names, model.period)
        system = linearize(model, *model.equilibrium)
        return Plant(system.A, system.B, *names)
    dt, labels = None, labels_of(A)
    other = read_system('A', A)
    if other is not None:
        A, B, dt = other.A, other.B, other.dt
    if isinstance(A, str):
        raise ValueError(
            f"A: expected a matrix or a model, got '{A}'; "
            f"the model of a scenario is kr.load('{A}').model"
        )
    A = square('A', A)
    B = columns('B', B, len(A))
    states = labels.states or numbered('x', len(A))
    return Plant(A, B, states, labels.inputs or numbered('u', B.shape[1]), dt)


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """Return names for what has none: x0, x1, ..."""
    return tuple(f'{letter}{i}' for i in range(count))


def shifted(A: Any, given: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return B and the arguments after it, shifted by one if ``A`` is a whole system."""
    if is_system(A) and given[0] is not None:
        if given[-1] is not None:
            raise ValueError('B: expected none beside a whole system')
        return (None, *given[:-1])
    return given


def sample_time(system: Plant, dt: Any) -> float | None:
    """Return the sample time of a system, or that which is given; None for continuous time.

    Raises
    ------
    ValueError
        If the system has another one than ``dt``.
    """
    if dt is None:
        return system.dt
    seconds = duration('dt', dt)
    if system.dt is not None and abs(seconds - system.dt) > 1e-9 * system.dt:
        raise ValueError(f'dt: the system has samples of {system.dt:g} s, got {seconds:g}')
    return seconds


def refuse_continuous(name: str, value: Any) -> None:
    """Raise ValueError for a whole system that is certainly in continuous time."""
    continuous = isinstance(value, Dynamics) and not value.is_discrete
    if not isinstance(value, Dynamics):
        system = read_system(name, value)
        continuous = system is not None and system.continuous
    if continuous:
        raise ValueError(
            f'{name}: expected a system in discrete time, got one in continuous time; '
            'kr.discretize samples it, and lqr has dt=...'
        )


def check_still(name: str, model: Dynamics) -> None:
    """Raise ValueError if a model does not rest at its equilibrium."""
    if not is_still(model, model.equilibrium):
        raise ValueError(
            f'{name}: the model does not rest where it is linearised: '
            f'{unrest(model, model.equilibrium)}; give it as equilibrium=... what kr.trim(model) '
            'finds'
        )


def belief_of(initial: Any, model: Dynamics, name: str = 'initial') -> Gaussian:
    """Return a checked belief about the state of a model, from a pair or a Gaussian."""
    n = model.state.size
    if isinstance(initial, str) and initial == DIFFUSE:
        return Gaussian(model.equilibrium.state, np.diag(np.full(n, np.inf)))
    if isinstance(initial, (list, np.ndarray)) and len(initial) == 2 and np.size(initial[0]) == n:
        initial = tuple(initial)
    if not isinstance(initial, tuple) or len(initial) < 2:
        first = f" at the first time, or '{DIFFUSE}'" if name == 'initial' else ''
        raise ValueError(
            f'{name}: expected a Gaussian or a pair of mean and covariance{first}, '
            f'got {got(initial)}'
        )
    mean, covariance = initial[0], initial[1]
    mean = by_name(f'{name} mean', mean, model.state)
    covariance = by_name(f'{name} covariance', covariance, model.state)
    mean = vector(f'{name} mean', np.ravel(numbers(f'{name} mean', mean)), n)
    return Gaussian(mean, _with_unknown(f'{name} covariance', covariance, n))


def _with_unknown(name: str, covariance: Any, n: int) -> Array:
    """Return a covariance (n, n), which may have infinite variances."""
    array = numbers(name, covariance)
    if not np.isinf(array).any():
        return weight(name, array, n)
    if array.shape == (n * n,):
        array = array.reshape(n, n)
    if np.isnan(array).any():
        raise ValueError(f'{name}: expected numbers, got NaN')
    infinite = np.isposinf(array.diagonal() if array.ndim == 2 else array)
    beside = infinite[:, np.newaxis] | infinite if array.ndim == 2 else infinite
    P = weight(name, np.where(beside, np.eye(*array.shape) if array.ndim == 2 else 1.0, array), n)
    unknown = np.flatnonzero(np.broadcast_to(infinite, n))
    P[unknown, unknown] = np.inf
    return P


def by_name(what: str, value: Any, space: Space) -> Any:
    """Return numbers in the order of a space, where a mapping or a table of pandas names them.

    A table whose labels are none of the names, such as row numbers, is taken as it stands.

    Raises
    ------
    ValueError
        If a name is unknown or missing.
    """
    if isinstance(value, Mapping):
        labels, array = list(value), np.array(list(value.values()))
    elif hasattr(value, 'to_numpy') and hasattr(value, 'index'):
        labels, array = list(value.index), np.asarray(value.to_numpy())
        if labels == list(range(len(labels))):
            return array
    else:
        return value
    order = [_places(what, labels, space)]
    if hasattr(value, 'columns'):
        order.append(_places(what, list(value.columns), space))
    return array[np.ix_(*order)]


def _places(what: str, labels: Sequence[Any], space: Space) -> list[int]:
    """Return the places of the names of a space among labels, which must be these names."""
    if sorted(map(str, labels)) != sorted(space.names):
        expected, got = ', '.join(space.names), ', '.join(map(str, labels))
        raise ValueError(f'{what}: expected {expected}, got {got}')
    return [labels.index(name) for name in space.names]


def number(name: str, value: Any, what: str = 'a number') -> float:
    """Return one number."""
    check_real(name, value)
    try:
        if not isinstance(value, (str, bytes, bytearray, bool, np.bool_)):
            return float(value)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ValueError(f'{name}: expected {what}, got {got(value)}')


def whole(name: str, value: Any, least: int = 0) -> int:
    """Return a whole number of at least ``least``; ValueError otherwise."""
    good = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not good or value < least:
        got = repr(value) if isinstance(value, (int, float, str)) else type(value).__name__
        raise ValueError(f'{name}: expected a whole number from {least}, got {got}')
    return int(value)


def finite(name: str, value: Any, size: int) -> Array:
    """Return ``size`` finite numbers."""
    array = vector(name, np.ravel(numbers(name, value)), size)
    if not np.isfinite(array).all():
        raise ValueError(f'{name}: expected finite numbers, got {array.tolist()}')
    return array


def seconds(name: str, value: Any) -> float:
    """Return a finite number of seconds from 0 on."""
    length = number(name, value, 'a number of seconds')
    if not 0.0 <= length < np.inf:
        raise ValueError(f'{name}: expected a number of seconds from 0, got {length:g}')
    return length


def duration(name: str, value: Any) -> float:
    """Return a positive, finite number of seconds."""
    seconds = number(name, value, 'a number of seconds')
    if not 0.0 < seconds < np.inf:
        raise ValueError(f'{name}: expected a positive number of seconds, got {seconds:g}')
    return seconds
