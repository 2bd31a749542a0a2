# SPDX-License-Identifier: Apache-2.0
"""Models and sensors from matrices or plain functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar, Union

import numpy as np

from kalman_ros.compiled import attempt
from kalman_ros.control.operating_point import is_still, unrest
from kalman_ros.core import (
    ArrayLike,
    DiscreteLinearSystem,
    DiscreteModel,
    Dynamics,
    LinearSystem,
    Model,
    Sensor,
    Space,
)
from kalman_ros.core.known_arguments import knows_arguments

from .accept import columns, duration, got, numbers, rows, space, square, weight
from .foreign import labels_of, read_system
from .functions import (
    DiscreteFunctionModel,
    Function,
    FunctionModel,
    FunctionSensor,
    MatrixSensor,
    count_arguments,
)
from .trimming import Point, operating_point

Names = Union[int, str, Sequence[str], None]
#: The longest step of an integration, in seconds, where none is given.
_LONGEST = 0.01
_Function = TypeVar('_Function', FunctionModel, DiscreteFunctionModel)


@knows_arguments(
    'readings y = C x belong to a sensor: kr.sensor(C, R)',
    Q='W',
    C='a sensor: kr.sensor(C, R)',
    D='a sensor: kr.sensor(C, R)',
)
def continuous_model(
    A: Any,
    B: ArrayLike | None = None,
    W: ArrayLike | None = None,
    *,
    states: Names = None,
    inputs: Names = None,
    angles: Sequence[str] = (),
    max_step: float | None = None,
    equilibrium: Point = None,
) -> Model:
    """Return the model dx/dt = A x + B u + w, or dx/dt = f(x, u) + w.

    ``continuous_model(A, B, W)``, or without an input ``continuous_model(A, W=W)``;
    ``continuous_model(f, W)`` and ``continuous_model(system, W)``, which include their input.

    Parameters
    ----------
    A
        A matrix (n, n), or a function f of a state (n,) and an input (m,), or of a state alone,
        which may accept arrays of states, which is faster; or a state-space system of
        python-control or scipy.signal, whose C and D belong to a `sensor`.
    B
        A matrix (n, m) for a matrix A; without it there is no input.
    W
        Spectral density of the white noise w (n, n): a matrix, its diagonal, or one number for
        every state. Over a short dt it adds the covariance W dt.
    states, inputs
        Their names, such as ``['x [m]', 'v [m/s]']``, or their number.
    angles
        The names of the states that wrap at +-pi.
    max_step
        The longest step, in seconds, of the Runge-Kutta integration of f; by default 0.01, or the
        time constant of the fastest mode at the equilibrium where that is shorter: steps that
        are longer than some three of it grow without bounds.
    equilibrium
        Where f is 0 and the model is linearised: a state and an input, such as `trim` finds, or
        values of some of them by name; by default all are 0.

    Raises
    ------
    ValueError
        If a size is wrong, the model does not rest at its equilibrium, W is not positive
        semi-definite, or a system is in discrete time.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> model = kr.continuous_model([[0, 1], [0, 0]], [0, 1], W=[0, 0.1], states='x [m] v [m/s]')
    >>> model.state.names
    ('x', 'v')
    """
    states, inputs = _labelled(A, states, inputs)
    A, B, W, _ = _parts(('A', 'B', 'W', 'continuous_model'), (A, B, W), sampled=False)
    if callable(A):
        state, input = _spaces(A, 'W', W, states, inputs, angles)
        step = _LONGEST if max_step is None else duration('max_step', max_step)
        model = FunctionModel(A, weight('W', W, state.size), state, input, step)
        model = _resting(model, equilibrium)
        if max_step is None:
            model.max_step = min(_LONGEST, _fastest(model))
        return model
    _refuse_rest(equilibrium)
    A = square('A', A)
    n = len(A)
    B = np.zeros((n, 0)) if B is None else columns('B', B, n)
    state = _named('states', states, n, 'x', angles)
    return LinearSystem(A, B, weight('W', W, n), state, _named('inputs', inputs, B.shape[1], 'u'))


@knows_arguments(
    'readings y = C x belong to a sensor: kr.sensor(C, R)',
    A='F',
    B='G',
    W='Q',
    dt='period',
    Ts='period',
    C='a sensor: kr.sensor(C, R)',
)
def discrete_model(
    F: Any,
    G: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    *,
    states: Names = None,
    inputs: Names = None,
    angles: Sequence[str] = (),
    period: float | None = None,
    equilibrium: Point = None,
) -> DiscreteModel:
    """Return the model x' = F x + G u + w, or x' = f(x, u) + w, once every ``period`` seconds.

    Parameters
    ----------
    F
        (n, n), a system in samples, or a function of the state, and of the input if there is one.
    G
        (n, m); for a function the covariance Q takes its place.
    Q
        Covariance of w (n, n).
    states, inputs, angles
        Names, as for `continuous_model`.
    period
        Seconds of a step; that of a system, or 1, by default.
    equilibrium
        State and input at which a function of them rests; as for `continuous_model`.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.discrete_model([[1, 0.1], [0, 1]], Q=[0, 0.01], period=0.1).period
    0.1
    """
    states, inputs = _labelled(F, states, inputs)
    F, G, Q, dt = _parts(('F', 'G', 'Q', 'discrete_model'), (F, G, Q), sampled=True)
    period = duration('period', dt or 1.0 if period is None else period)
    if dt is not None and period != dt:
        raise ValueError(f'period: expected that of the system, {dt:g} s, got {period:g}')
    if callable(F):
        state, input = _spaces(F, 'Q', Q, states, inputs, angles)
        covariance = weight('Q', Q, state.size)
        return _resting(DiscreteFunctionModel(F, covariance, state, input, period), equilibrium)
    _refuse_rest(equilibrium)
    F = square('F', F)
    n = len(F)
    G = np.zeros((n, 0)) if G is None else columns('G', G, n)
    state = _named('states', states, n, 'x', angles)
    input = _named('inputs', inputs, G.shape[1], 'u')
    return DiscreteLinearSystem(F, G, weight('Q', Q, n), state, input, period)


def _fastest(model: Model) -> float:
    """Return the time constant of the fastest mode at the equilibrium; infinite if not known."""
    with np.errstate(all='ignore'):
        A = model.state_jacobian(*model.equilibrium)
    rate = float(np.abs(np.linalg.eigvals(A)).max(initial=0.0)) if np.isfinite(A).all() else 0.0
    return 1.0 / rate if rate > 0.0 else np.inf


def _resting(model: _Function, given: Point) -> _Function:
    """Return a model of a function with its equilibrium."""
    if given is None:
        return model
    point = operating_point(model, 'equilibrium', given)
    if not is_still(model, point):
        raise ValueError(f'equilibrium: {unrest(model, point)} there; kr.trim finds a rest')
    model.rest = point
    return model


def _refuse_rest(given: Point) -> None:
    if given is not None:
        raise ValueError('equilibrium: expected none beside matrices, whose equilibrium is 0')


@knows_arguments(C='H', V='R', states='no matter: columns of H are the states')
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

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.sensor([1, 0], 0.25, 'gps')
    MatrixSensor 'gps'(reads: gps; covariance: [[0.25]])
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


def _parts(
    names: tuple[str, str, str, str], given: tuple[Any, Any, Any], *, sampled: bool
) -> tuple[Any, Any, Any, float | None]:
    """Return the matrix or function, the input matrix, the noise, and the period of a system.

    The noise follows a function or a system at once, for these include their input.
    """
    whole, inputs, noise, maker = names
    A, B, W = given
    if isinstance(A, Dynamics):
        raise ValueError(f'{whole}: expected a matrix, a function or a system, got a model')
    system = read_system(whole, A)
    if (system is not None or callable(A)) and B is not None:
        if W is not None:
            raise ValueError(f'{inputs}: expected none beside a function or a whole system')
        B, W = None, B
    dt = None
    if system is not None:
        A, B, dt = system.A, system.B, system.dt
        if system.continuous if sampled else dt is not None:
            time, other = (
                ('continuous', 'continuous_model') if sampled else ('discrete', 'discrete_model')
            )
            raise ValueError(f'{whole}: {maker} got a system in {time} time; use {other}')
    if W is None:
        raise ValueError(
            f'{noise}: expected the noise, got nothing; {maker}({whole}, {inputs}, {noise}), '
            f'or {noise}=... for a model without an input'
        )
    return A, B, W, dt


def _labelled(system: Any, states: Names, inputs: Names) -> tuple[Names, Names]:
    """Return the names of states and inputs: those given, else those of a system that has any."""
    labels = labels_of(system)
    return labels[0] if states is None else states, labels[1] if inputs is None else inputs


def _size(names: Names) -> int:
    """Return the number of names; 0 if unknown."""
    if names is None:
        return 0
    return int(names) if isinstance(names, (int, np.integer)) else space('names', names, '').size


def _named(what: str, names: Names, size: int, prefix: str, angles: Sequence[str] = ()) -> Space:
    coordinates = space(what, size if names is None else names, prefix, angles)
    if coordinates.size != size:
        raise ValueError(f'{what}: expected {size} names, got {coordinates.size}')
    return coordinates


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


def compile(part: Model | Sensor, state: Space | None = None) -> Any:
    """Return a model or a sensor whose functions are C: the same results, some ten times as fast.

    The original stays as it is, and the result has the numbers that it has now. Jacobians become
    exact. Without CasADi (the extra ``kalman_ros[compiled]``) or a C compiler, and where a
    function is no formula, the result is slower, or the original: its ``arithmetic`` is ``'C'``,
    ``'CasADi'``, ``'numpy'``, or missing.

    Parameters
    ----------
    part
        A model, or a sensor.
    state
        The space of the states that a sensor measures; only for a sensor.

    Raises
    ------
    ValueError
        If it is something else, or a sensor without the space of its states.

    Examples
    --------
    >>> import numpy as np
    >>> import kalman_ros as kr
    >>> model = kr.compile(kr.load('cart_pole').model)
    >>> model.step(np.array([0.0, 0.0, 0.1, 0.0]), np.zeros(1), 0.1).round(3)
    array([0.001, 0.028, 0.116, 0.326])
    """
    if isinstance(part, Sensor):
        if not isinstance(state, Space):
            raise ValueError(
                f'state: expected the space of the states that the sensor measures, such as '
                f'model.state, got {got(state)}'
            )
        part = part.of(state)
    elif not isinstance(part, Dynamics):
        raise ValueError(f'part: expected a model or a sensor, got {got(part)}')
    return attempt(part, state).result
