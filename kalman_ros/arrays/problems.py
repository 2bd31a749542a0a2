# SPDX-License-Identifier: Apache-2.0
"""Models and sensors from matrices or plain functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from inspect import signature
from math import prod
from typing import Union

import numpy as np

from kalman_ros.core import (
    Array,
    ArrayLike,
    DiscreteLinearSystem,
    DiscreteModel,
    LinearSystem,
    Model,
    Sensor,
    Space,
    numerical_jacobian,
)

from .accept import columns, duration, numbers, rows, space, square, weight

#: A function of a state (n,) and an input (m,), or of a state alone.
Function = Callable[..., ArrayLike]
Names = Union[int, str, Sequence[str], None]


def continuous_model(
    A: ArrayLike | Function,
    W: ArrayLike,
    B: ArrayLike | None = None,
    *,
    states: Names = None,
    inputs: Names = None,
    angles: Sequence[str] = (),
    max_step: float = 0.01,
) -> Model:
    """Return the model dx/dt = A x + B u + w, or dx/dt = f(x, u) + w: ``continuous_model(f, W)``.

    Parameters
    ----------
    A
        A matrix (n, n), or a function f of a state (n,) and an input (m,), or of a state alone. It
        need not take several states at once, but is quicker if it does.
    W
        Spectral density of the white noise w (n, n): a matrix, its diagonal, or one number for
        every state. Over a short dt it adds the covariance W dt.
    B
        A matrix (n, m) for a matrix A; without it there is no input.
    states, inputs
        Their names, such as ``['x [m]', 'v [m/s]']``, or their number.
    angles
        The names of the states that wrap at +-pi.
    max_step
        The longest step, in seconds, of the Runge-Kutta integration of f.

    Raises
    ------
    ValueError
        If a size is wrong, or W is not positive semi-definite.
    """
    if callable(A):
        state, input = _spaces(A, 'W', W, states, inputs, angles)
        return FunctionModel(
            A, weight('W', W, state.size), state, input, duration('max_step', max_step)
        )
    A = square('A', A)
    n = len(A)
    B = np.zeros((n, 0)) if B is None else columns('B', B, n)
    state = _named('states', states, n, 'x', angles)
    return LinearSystem(A, B, weight('W', W, n), state, _named('inputs', inputs, B.shape[1], 'u'))


def discrete_model(
    F: ArrayLike | Function,
    Q: ArrayLike,
    G: ArrayLike | None = None,
    *,
    states: Names = None,
    inputs: Names = None,
    angles: Sequence[str] = (),
    period: float = 1.0,
) -> DiscreteModel:
    """Return the model x' = F x + G u + w, or x' = f(x, u) + w, once every ``period`` seconds.

    Q (n, n) is the covariance of w; all else is as for `continuous_model`.
    """
    period = duration('period', period)
    if callable(F):
        state, input = _spaces(F, 'Q', Q, states, inputs, angles)
        return DiscreteFunctionModel(F, weight('Q', Q, state.size), state, input, period)
    F = square('F', F)
    n = len(F)
    G = np.zeros((n, 0)) if G is None else columns('G', G, n)
    state = _named('states', states, n, 'x', angles)
    input = _named('inputs', inputs, G.shape[1], 'u')
    return DiscreteLinearSystem(F, G, weight('Q', Q, n), state, input, period)


def sensor(
    H: ArrayLike | Function,
    R: ArrayLike,
    name: str = 'y',
    *,
    outputs: Names = None,
    angles: Sequence[str] = (),
    jacobian: Function | None = None,
) -> Sensor:
    """Return the sensor y = H x + v, or y = h(x) + v, with v ~ N(0, R): ``sensor([1, 0], 0.25)``.

    Parameters
    ----------
    H
        A matrix (k, n), n numbers for a single reading, or a function h of a state (n,).
    R
        The covariance of a reading (k, k): a matrix, its diagonal, or one number for all. These
        are variances, not standard deviations.
    name
        What the sensor is called in results.
    outputs
        The names of what it reads, such as ``'range [m]'``, or how many numbers those are.
    angles
        The names of the outputs that wrap at +-pi.
    jacobian
        For a function h: one that returns dh/dx (k, n) at a state; numerical by default.

    Raises
    ------
    ValueError
        If a size is wrong, or R is not positive definite.
    """
    if not name:
        raise ValueError("name: expected a word, such as 'gps', got ''")
    if callable(H):
        k = _size(outputs) or numbers('R', R).shape[:1] or (1,)
        k = k if isinstance(k, int) else k[0]
    else:
        array = numbers('H', H)
        H = rows('H', array, array.shape[-1] if array.ndim else 1)
        k = len(H)
    prefix = [name] if k == 1 else [f'{name}{index}' for index in range(k)]
    output = _named('outputs', outputs if outputs is not None else prefix, k, name, angles)
    R = weight('R', R, k, definite=True)
    if callable(H):
        return FunctionSensor(H, output, R, name, jacobian)
    return MatrixSensor(H, output, R, name)


def _size(names: Names) -> int:
    """Return how many names there are; 0 if that is not said."""
    if names is None:
        return 0
    return int(names) if isinstance(names, (int, np.integer)) else space('names', names, '').size


def _named(what: str, names: Names, size: int, prefix: str, angles: Sequence[str] = ()) -> Space:
    found = space(what, size if names is None else names, prefix, angles)
    if found.size != size:
        raise ValueError(f'{what}: expected {size} names, got {found.size}')
    return found


def _spaces(
    f: Function, what: str, noise: ArrayLike, states: Names, inputs: Names, angles: Sequence[str]
) -> tuple[Space, Space]:
    """Return the spaces of a function's state and input."""
    array = numbers('noise', noise)
    n = _size(states) or (len(array) if array.ndim else 0)
    if not n:
        raise ValueError(f'states: expected names or a number, for {what} does not tell how many')
    if inputs is None and _arguments(f) > 1:
        inputs = 0
    state = _named('states', states, n, 'x', angles)
    return state, space('inputs', inputs if inputs is not None else 0, 'u')


def _arguments(f: Function) -> int:
    """Return how many arguments without a default a function takes."""
    try:
        parameters = signature(f).parameters.values()
    except (TypeError, ValueError):  # a builtin
        return 2
    return sum(p.default is p.empty and p.kind in (0, 1) for p in parameters)


def _of_both(f: Function) -> Function:
    """Return a function of state and input, whichever it takes."""
    if _arguments(f) > 1:
        return f
    return lambda x, u: f(x)


class _Each:
    """A function of vectors, made one of arrays of vectors: at once if it can, else one by one."""

    def __init__(self, f: Function, what: str, sizes: Sequence[int], size: int) -> None:
        self._f, self._size = f, size
        rng = np.random.default_rng(0)
        points = [rng.uniform(0.5, 1.5, (3, n)) for n in sizes]
        single = [self._one(what, *(p[i] for p in points)) for i in range(3)]
        try:
            together = np.asarray(f(*points), dtype=float)
            self._at_once = together.shape == (3, size) and np.allclose(together, single)
        except Exception:  # it is a user's own, and may fail as it likes on what it is not for
            self._at_once = False

    def _one(self, what: str, *point: Array) -> Array:
        try:
            found = np.atleast_1d(np.asarray(self._f(*point), dtype=float))
        except Exception as error:
            raise ValueError(f'{what} fails: {type(error).__name__}: {error}') from error
        if found.shape != (self._size,):
            raise ValueError(f'{what}: expected {self._size} numbers, got shape {found.shape}')
        return found

    def __call__(self, *arguments: Array) -> Array:
        if self._at_once:
            return np.asarray(self._f(*arguments), dtype=float)
        if arguments[0].ndim == 1:
            return np.asarray(self._f(*arguments), dtype=float).reshape(self._size)
        lead = arguments[0].shape[:-1]
        sizes = [a.shape[-1] for a in arguments]
        whole = (np.broadcast_to(a, (*lead, k)) for a, k in zip(arguments, sizes))
        flat = [a.reshape(prod(lead), k) for a, k in zip(whole, sizes)]
        each = [np.asarray(self._f(*point), dtype=float) for point in zip(*flat)]
        return np.array(each).reshape(*lead, self._size)


class FunctionModel(Model):
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


class DiscreteFunctionModel(DiscreteModel):
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
        if self._h is None:  # only a state tells how many numbers one has
            what = f'{self.name}: its function'
            self._h = _Each(self._own, what, (x.shape[-1],), self.output.size)
        return self._h(x)

    def jacobian(self, x: Array) -> Array:
        """Return dh/dx."""
        if self._jacobian is None:
            return numerical_jacobian(self.measure, x, self.output.subtract)
        return rows(f'{self.name}: its jacobian', self._jacobian(x), x.size)
