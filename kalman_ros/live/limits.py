# SPDX-License-Identifier: Apache-2.0
"""Limits of the input and of the states on a live page, which a user drags."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from typing import Any

from kalman_ros.control.laws import STATE_LIMIT, WITHIN_LIMITS

from .adjustments import Adjustments

#: Parameter with the largest magnitude of each input.
_INPUT = 'input_limit'


def limits(adjustments: Adjustments) -> dict[str, Any]:
    """Return the limits for JSON; None for a limit that does not exist.

    The result has the largest magnitude of each ``input``, the lowest and highest value of each
    ``state`` by name, and the ``reason`` for which states have no limits, '' if they can have.
    """
    if not adjustments.driven:
        return {'input': [], 'state': {}, 'reason': 'the model has no input'}
    law = str(adjustments.value('controller', 'law'))
    state: dict[str, list[float | None]] = {}
    reason = f'the law {law} keeps no limits of states, choose {" or ".join(WITHIN_LIMITS)}'
    if law in WITHIN_LIMITS:
        names = adjustments.scenario('controller').model.state.names
        state = {name: _finite(_of_state(adjustments, name)) for name in names}
        reason = ''
    return {'input': _finite(_of_inputs(adjustments)), 'state': state, 'reason': reason}


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
        ``'low'`` or ``'high'`` for a state; an input is limited on both sides alike.
    value
        New limit; None for no limit.

    Raises
    ------
    ValueError
        If there is no such limit, or the limits of a state contain no value.
    """
    known = limits(adjustments)
    model = adjustments.scenario('controller').model if adjustments.driven else None
    if of == 'input' and model is not None and name in model.input.names:
        magnitudes = _of_inputs(adjustments)
        magnitudes[model.input.names.index(name)] = inf if value is None else abs(value)
        return {_INPUT: magnitudes}
    if of == 'state' and known['reason']:
        raise ValueError(f'limit: {known["reason"]}')
    if of != 'state' or name not in known['state'] or side not in ('low', 'high'):
        raise ValueError('limit: expected the name of an input, or of a state and low or high')
    low, high = _of_state(adjustments, name)
    if side == 'low':
        low = -inf if value is None else value
    else:
        high = inf if value is None else value
    if not low < high:
        raise ValueError(f'limit of {name}: expected low < high, got {low:g} and {high:g}')
    return {f'{STATE_LIMIT}.{name}': [low, high]}


def _of_inputs(adjustments: Adjustments) -> list[float]:
    """Return the largest magnitude of each input; the parameter may have one for all."""
    size = adjustments.scenario('controller').model.input.size
    values = [float(value) for value in adjustments.value('controller', _INPUT)]
    return values * size if len(values) == 1 else values


def _of_state(adjustments: Adjustments, name: str) -> list[float]:
    return [float(value) for value in adjustments.value('controller', f'{STATE_LIMIT}.{name}')]


def _finite(values: Sequence[float]) -> list[float | None]:
    return [value if isfinite(value) else None for value in values]
