# SPDX-License-Identifier: Apache-2.0
"""Limits of the input and of the states on a live page, which a user drags."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from typing import Any

from kalman_ros.control.laws import STATE_LIMIT, WITHIN_LIMITS
from kalman_ros.control.limiter import limits_of
from kalman_ros.core import one_each

from .adjustments import Adjustments

#: Parameters with the smallest and the largest value of each input.
_LOWER, _UPPER = 'input_lower_limit', 'input_limit'


def limits(adjustments: Adjustments) -> dict[str, Any]:
    """Return the limits for JSON; None for a limit that does not exist.

    The result has the lowest and highest value of each ``input`` and ``state`` by name, the
    inputs whose limits are ``alike``, one minus the other, and the ``reason`` for which states
    have no limits, '' if they can have.
    """
    if not adjustments.driven:
        return {'input': {}, 'alike': [], 'state': {}, 'reason': 'the model has no input'}
    law = str(adjustments.value('controller', 'law'))
    state: dict[str, list[float | None]] = {}
    reason = f'the law {law} keeps no limits of states, choose {" or ".join(WITHIN_LIMITS)}'
    if law in WITHIN_LIMITS:
        names = adjustments.scenario('controller').model.state.names
        state = {name: _finite(_of_state(adjustments, name)) for name in names}
        reason = ''
    names, lower, upper = _of_inputs(adjustments)
    bounds = limits_of(len(names), {_LOWER: lower, _UPPER: upper})
    pairs = zip(names, bounds.lower.tolist(), bounds.upper.tolist())
    input = {name: _finite(pair) for name, *pair in pairs}
    alike = [name for name, low in zip(names, lower) if low == -inf]
    return {'input': input, 'alike': alike, 'state': state, 'reason': reason}


def limited(
    adjustments: Adjustments, of: str, name: str, side: str, value: float | None
) -> dict[str, Any]:
    """Return the parameters of the controller with another limit.

    Parameters
    ----------
    adjustments
        Current parameters.
    of, name
        ``'state'`` or ``'input'``, and the name of the coordinate.
    side
        ``'low'`` or ``'high'``; limits of an input that are alike move together.
    value
        New limit; None for no limit.

    Raises
    ------
    ValueError
        If there is no such limit, or the limits contain no value.
    """
    known = limits(adjustments)
    if of == 'input' and name in known['input']:
        return _limited_input(adjustments, name, side, value)
    if of == 'state' and known['reason']:
        raise ValueError(f'limit: {known["reason"]}')
    if of != 'state' or name not in known['state'] or side not in ('low', 'high'):
        raise ValueError('limit: expected the name of an input, or of a state and low or high')
    low, high = _of_state(adjustments, name)
    if side == 'low':
        low = -inf if value is None else value
    else:
        high = inf if value is None else value
    _check(name, low, high)
    return {f'{STATE_LIMIT}.{name}': [low, high]}


def _limited_input(
    adjustments: Adjustments, name: str, side: str, value: float | None
) -> dict[str, Any]:
    """Return the parameters with another limit of an input."""
    names, lower, upper = _of_inputs(adjustments)
    index, before = names.index(name), lower.copy()
    if lower[index] == -inf:
        upper[index] = inf if value is None else abs(value)
    elif side == 'low':
        if value is None:
            raise ValueError(f'limit of {name}: expected a lowest value beside the highest one')
        lower[index] = value
    else:
        upper[index] = inf if value is None else value
    _check(name, lower[index], upper[index])
    return {_UPPER: upper, **({} if lower == before else {_LOWER: lower})}


def _of_inputs(adjustments: Adjustments) -> tuple[tuple[str, ...], list[float], list[float]]:
    """Return the names of the inputs, and their parameters, one for each."""
    names = adjustments.scenario('controller').model.input.names
    lower, upper = (
        one_each(name, adjustments.value('controller', name), len(names)).tolist()
        for name in (_LOWER, _UPPER)
    )
    return names, lower, upper


def _check(name: str, low: float, high: float) -> None:
    if not low < high:
        raise ValueError(f'limit of {name}: expected low < high, got {low:g} and {high:g}')


def _of_state(adjustments: Adjustments, name: str) -> list[float]:
    return [float(value) for value in adjustments.value('controller', f'{STATE_LIMIT}.{name}')]


def _finite(values: Sequence[float]) -> list[float | None]:
    return [value if isfinite(value) else None for value in values]
