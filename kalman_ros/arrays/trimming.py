# SPDX-License-Identifier: Apache-2.0
"""Operating points of a model, and its linear system there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Optional, Union

import numpy as np

from kalman_ros.control.operating_point import find_rest
from kalman_ros.core import (
    Array,
    ArrayLike,
    DiscreteLinearSystem,
    DiscreteModel,
    Dynamics,
    LinearSystem,
    Model,
    OperatingPoint,
    Space,
    refuse_unknown,
)
from kalman_ros.core import linearize as linear_system
from kalman_ros.core.known_arguments import knows_arguments

from .accept import check_still, number, numbers
from .foreign import is_foreign

#: A state and an input, or values of some of them by name; others are at the equilibrium.
Point = Optional[Union[Sequence[ArrayLike], Mapping[str, float]]]


@knows_arguments(x0='near', x='near')
def trim(model: Model | DiscreteModel, given: Point = None, near: Point = None) -> OperatingPoint:
    """Return a state and an input at which a model rests.

    Give the result to `continuous_model` or `discrete_model` as the ``equilibrium``.

    Parameters
    ----------
    model
        The model.
    given
        Values of states and inputs, by name, that hold; the others are found.
    near
        Where the search begins: values by name, or a state and an input.

    Raises
    ------
    ValueError
        If a name is unknown, or no rest is found; the message names what still changes.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> def lift(x, u):
    ...     return [x[1], u[0] / 2.0 - 9.81]
    >>> model = kr.continuous_model(lift, [0, 1], states='z [m] v [m/s]', inputs='thrust [N]')
    >>> kr.trim(model, {'z': 10.0})
    OperatingPoint(state=array([10.,  0.]), input=array([19.62]))
    """
    _check(model)
    held = {} if given is None else given
    if not isinstance(held, Mapping):
        raise ValueError(f'given: expected values by name, got {type(held).__name__}')
    start = operating_point(model, 'near', near)
    start = _with(model, 'given', start, held)
    state, input = (
        np.array([name not in held for name in space.names], dtype=bool)
        for space in (model.state, model.input)
    )
    try:
        return find_rest(model, start, state, input)
    except ValueError as error:
        raise ValueError(f'model: {error}; try another near=...') from None


@knows_arguments(x='point', x0='point', u='input', u0='input')
def linearize(
    model: Model | DiscreteModel, point: Point = None, input: ArrayLike | None = None
) -> LinearSystem | DiscreteLinearSystem:
    """Return the linear system of small deviations from a point, with the model's noise.

    Its ``A`` and ``B``, or ``F`` and ``G`` in discrete time, are the Jacobians.

    Parameters
    ----------
    model
        The model.
    point
        A state, a state and an input, or values of some of them by name; by default the
        equilibrium, whose input is also that of a state alone. At a point where the model does
        not rest, deviations are those from its motion.
    input
        The input, where ``point`` is a state.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> pole = kr.load('cart_pole').model
    >>> kr.linearize(pole, {'theta': 3.14159}).A.shape
    (4, 4)
    """
    _check(model)
    if point is None:
        check_still('model', model)
    both: Any = point
    if input is not None:
        if point is None or isinstance(point, Mapping):
            raise ValueError('input: expected a state beside it; or give values of both by name')
        both = point, input
    x, u = operating_point(model, 'point', both)
    if not isinstance(model, DiscreteModel):
        return linear_system(model, x, u)
    F, G = model.next_jacobian(x, u)
    return DiscreteLinearSystem(
        F, G, model.noise(x), model.state.tangent, model.input, model.period
    )


def _check(model: Any) -> None:
    """Raise ValueError if it is no model; the message has what makes one."""
    if not isinstance(model, Dynamics):
        hint = ''
        if is_foreign(model):
            hint = '; a linear system rests at 0'
        elif isinstance(model, str):
            hint = f"; that of a scenario is kr.load('{model}').model"
        elif callable(model):
            hint = (
                '; of a function dx/dt = f(x, u) it is kr.continuous_model(f, inputs=..., W=...)'
            )
        raise ValueError(f'model: expected a model, got {type(model).__name__}{hint}')


def operating_point(model: Dynamics, what: str, given: Point) -> OperatingPoint:
    """Return a state (n,) and an input (m,) that are given in any way.

    Raises
    ------
    ValueError
        If a size or a name is wrong, or a number is not finite.
    """
    rest = model.equilibrium
    if given is None:
        return rest
    if isinstance(given, Mapping):
        return _with(model, what, rest, given)
    if _is_state(given, model.state.size):
        alone: Any = given
        return OperatingPoint(_vector(f"{what}'s state", alone, model.state), rest.input)
    if isinstance(given, (str, bytes)) or not isinstance(given, Sequence) or len(given) != 2:
        raise ValueError(f'{what}: expected a state, a state and an input, or values by name')
    parts = zip(('state', 'input'), given, (model.state, model.input))
    x, u = (_vector(f"{what}'s {name}", part, space) for name, part, space in parts)
    return OperatingPoint(x, u)


def _is_state(given: Any, size: int) -> bool:
    """Return whether a point is the numbers of a state, rather than a state and an input."""
    plain = isinstance(given, np.ndarray) or (
        isinstance(given, Sequence) and all(np.ndim(part) == 0 for part in given)
    )
    return plain and np.shape(given) == (size,)


def _with(
    model: Dynamics, what: str, point: OperatingPoint, values: Mapping[str, Any]
) -> OperatingPoint:
    """Return a point with other values of some coordinates."""
    refuse_unknown(map(str, values), [*model.state.names, *model.input.names], f'name in {what}')
    x, u = (part.astype(float) for part in point)
    for name, value in values.items():
        coordinate = number(f'{what}: {name}', value)
        if not np.isfinite(coordinate):
            raise ValueError(f'{what}: {name}: expected a finite number, got {coordinate:g}')
        part, space = (x, model.state) if name in model.state.names else (u, model.input)
        part[space.names.index(name)] = coordinate
    return OperatingPoint(x, u)


def _vector(what: str, value: ArrayLike, space: Space) -> Array:
    """Return finite numbers (n,) of a space."""
    array = np.atleast_1d(numbers(what, value)).astype(float)
    if array.shape != (space.size,) or not np.isfinite(array).all():
        raise ValueError(f'{what}: expected {space.size} finite numbers, got {array.tolist()}')
    return array
