# SPDX-License-Identifier: Apache-2.0
"""Models and sensors from a user's functions or matrices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from inspect import signature
from math import prod
from typing import Any

import numpy as np

from kalman_ros.core import (
    Array,
    ArrayLike,
    DiscreteModel,
    Dynamics,
    Model,
    OperatingPoint,
    Sensor,
    Space,
    check_real,
    numerical_jacobian,
)

from .accept import rows

#: A function of a state (n,) and an input (m,), or of a state alone.
Function = Callable[..., ArrayLike]


def count_arguments(f: Function) -> int:
    """Return the number of arguments without a default."""
    try:
        parameters = signature(f).parameters.values()
    except (TypeError, ValueError):  # a builtin
        return 2
    return sum(p.default is p.empty and p.kind in (0, 1) for p in parameters)


def _of_both(f: Function) -> Function:
    """Return a function of state and input, for one of either signature."""
    if count_arguments(f) > 1:
        return f
    return lambda x, u: f(x)


def _real(what: str, value: ArrayLike) -> Array:
    """Return what a function returned as an array."""
    check_real(what, value)
    array: Any = np.asarray(value)
    if array.dtype == object:
        flat = [entry.item() if isinstance(entry, np.ndarray) else entry for entry in array.flat]
        if any(hasattr(entry, 'formula') for entry in flat):  # formulas are being recorded
            array.flat = flat
            whole: Array = array
            return whole
    return np.array(value, dtype=float)


#: The numbers of points at which a function of many is compared with that of one: no size of a
#: state equals both, so none is taken for the other.
_MANY = 7, 11


class _Each:
    """Applies a function of vectors to arrays of vectors: at once if possible, else one by one.

    The function gets copies, and its results are copied, so that neither what it does to its
    arguments nor an array that it returns again is seen elsewhere.
    """

    #: For `compiled.free_parameters`: that the numbers of a function are parameters, too.
    HAS_FUNCTION = True

    def __init__(self, f: Function, what: str, sizes: Sequence[int], size: int) -> None:
        self._f, self._size, self._what = f, size, what
        rng = np.random.default_rng(0)
        self._one(*(rng.uniform(0.5, 1.5, n) for n in sizes))
        with np.errstate(all='ignore'):
            self._at_once = all(self._agrees(rng, count, sizes) for count in _MANY)

    def _agrees(self, rng: np.random.Generator, count: int, sizes: Sequence[int]) -> bool:
        """Return whether ``count`` points at once, of any size and sign, are as one by one."""
        scales = 10.0 ** rng.uniform(-2.0, 4.0, (count, 1))
        points = [scales * rng.uniform(-1.0, 1.0, (count, n)) for n in sizes]
        try:
            single = [self._one(*(p[i] for p in points)) for i in range(count)]
            together = np.asarray(self._f(*(p.copy() for p in points)), dtype=float)
        except Exception:  # a user's function may fail on arrays in any way
            return False
        return together.shape == (count, self._size) and bool(
            np.allclose(together, single, rtol=1e-9, atol=0.0, equal_nan=True)
        )

    def _one(self, *point: Array) -> Array:
        try:
            values = np.atleast_1d(
                _real(self._what, self._f(*(argument.copy() for argument in point)))
            )
        except Exception as error:
            taken = ' and '.join(f'an array of {argument.size}' for argument in point)
            why = f'{type(error).__name__}: {error}'
            raise ValueError(f'{self._what} fails, given {taken}: {why}') from error
        if values.shape != (self._size,):
            raise ValueError(
                f'{self._what}: expected {self._size} numbers, got shape {values.shape}'
            )
        return values

    def __call__(self, *arguments: Array) -> Array:
        if self._at_once:
            return _real(self._what, self._f(*(argument.copy() for argument in arguments)))
        if arguments[0].ndim == 1:
            value = self._f(*(argument.copy() for argument in arguments))
            return _real(self._what, value).reshape(self._size)
        lead = arguments[0].shape[:-1]
        flat = []
        for argument in arguments:
            whole = (*lead, argument.shape[-1])
            argument = argument if argument.shape == whole else np.broadcast_to(argument, whole)
            flat.append(np.array(argument).reshape(prod(lead), whole[-1]))
        one_by_one = [_real(self._what, self._f(*point)) for point in zip(*flat)]
        return np.array(one_by_one).reshape(*lead, self._size)


class _Resting(Dynamics):
    """A model with an equilibrium that is given."""

    #: Where it rests; None at zero.
    rest: OperatingPoint | None = None

    @property
    def equilibrium(self) -> OperatingPoint:
        """Where it rests."""
        return super().equilibrium if self.rest is None else self.rest


class FunctionModel(_Resting, Model):
    """dx/dt = f(x, u) + w."""

    def __init__(self, f: Function, W: Array, state: Space, input: Space, max_step: float) -> None:
        self.state, self.input, self.max_step, self._W = state, input, max_step, W
        self._f = _Each(_of_both(f), 'A: its derivative', (state.size, input.size), state.size)

    def derivative(self, x: Array, u: Array) -> Array:
        """Return f(x, u)."""
        return self._f(x, u)

    def noise_density(self, x: Array) -> Array:
        """Return W."""
        return self._W


class DiscreteFunctionModel(_Resting, DiscreteModel):
    """x' = f(x, u) + w."""

    def __init__(self, f: Function, Q: Array, state: Space, input: Space, period: float) -> None:
        self.state, self.input, self.period, self._Q = state, input, period, Q
        self._f = _Each(_of_both(f), 'F: its next state', (state.size, input.size), state.size)

    def next(self, x: Array, u: Array) -> Array:
        """Return f(x, u)."""
        return self._f(x, u)

    def noise(self, x: Array) -> Array:
        """Return Q."""
        return self._Q


class MatrixSensor(Sensor):
    """y = H x + v."""

    linear = True

    def __init__(self, H: Array, output: Space, R: Array, name: str) -> None:
        self.output, self.covariance, self.name = output, R, name
        self._H = np.asfortranarray(H)

    def measure(self, x: Array) -> Array:
        """Return H x."""
        return np.asarray(x.dot(self._H.T))

    def jacobian(self, x: Array) -> Array:
        """Return H."""
        return self._H

    def of(self, state: Space) -> MatrixSensor:
        """Return the sensor of a ``state``: a row that reads an angle of it reads an angle."""
        if self.output.angles or not state.angles:
            return self
        angles = np.eye(state.size)[state.indices(state.angles)]
        reads = (self._H[:, np.newaxis] == angles).all(axis=-1).any(axis=1)
        if not reads.any():
            return self
        names = tuple(name for name, does in zip(self.output.names, reads) if does)
        return MatrixSensor(
            self._H, replace(self.output, angles=names), self.covariance, self.name
        )


class FunctionSensor(Sensor):
    """y = h(x) + v."""

    def __init__(
        self, h: Function, output: Space, R: Array, name: str, jacobian: Function | None
    ) -> None:
        self.output, self.covariance, self.name = output, R, name
        self._own, self._jacobian = h, jacobian
        self._h: _Each | None = None

    def measure(self, x: Array) -> Array:
        """Return h(x)."""
        if self._h is None:  # the size is known only after a call
            what = f'{self.name}: its function'
            self._h = _Each(self._own, what, (x.shape[-1],), self.output.size)
        return self._h(x)

    def jacobian(self, x: Array) -> Array:
        """Return dh/dx."""
        if self._jacobian is None:
            return numerical_jacobian(self.measure, x, self.output.subtract, self.state)
        return rows(f'{self.name}: its jacobian', self._jacobian(x), x.size)
