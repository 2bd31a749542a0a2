# SPDX-License-Identifier: Apache-2.0
"""Models and sensors from matrices or plain functions."""

from __future__ import annotations

from collections.abc import Sequence
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
)

from .accept import columns, duration, numbers, rows, space, square, weight
from .functions import (
    DiscreteFunctionModel,
    Function,
    FunctionModel,
    FunctionSensor,
    MatrixSensor,
    count_arguments,
)

Names = Union[int, str, Sequence[str], None]


def continuous_model(
    A: ArrayLike | Function,
    W: ArrayLike,
    *,
    B: ArrayLike | None = None,
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
        may accept arrays of states, which is faster.
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
    return LinearSystem(
        A, B, _noise('W', W, n, 'B'), state, _named('inputs', inputs, B.shape[1], 'u')
    )


def discrete_model(
    F: ArrayLike | Function,
    Q: ArrayLike,
    *,
    G: ArrayLike | None = None,
    states: Names = None,
    inputs: Names = None,
    angles: Sequence[str] = (),
    period: float = 1.0,
) -> DiscreteModel:
    """Return the model x' = F x + G u + w, or x' = f(x, u) + w, once every ``period`` seconds.

    Q (n, n) is the covariance of w; otherwise as for `continuous_model`.
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
    return DiscreteLinearSystem(F, G, _noise('Q', Q, n, 'G'), state, input, period)


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
        Its name in results.
    outputs
        The names of its outputs, such as ``'range [m]'``, or their number.
    angles
        The names of the outputs that wrap at +-pi.
    jacobian
        For a function h: a function that returns dh/dx (k, n) at a state; numerical by default.

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


def _noise(name: str, value: ArrayLike, n: int, other: str) -> Array:
    """Return a checked noise (n, n); the error for an input matrix names the argument for it."""
    shape = numbers(name, value).shape
    if len(shape) == 2 and shape[0] == n != shape[1]:
        raise ValueError(
            f'{name}: expected the noise, a {n} x {n} matrix or its diagonal, got shape {shape}; '
            f'an input matrix is given by name, {other}=...'
        )
    return weight(name, value, n)


def _size(names: Names) -> int:
    """Return the number of names; 0 if unknown."""
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
    if inputs is None and count_arguments(f) > 1:
        inputs = 0
    state = _named('states', states, n, 'x', angles)
    return state, space('inputs', inputs if inputs is not None else 0, 'u')
