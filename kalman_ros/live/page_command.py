# SPDX-License-Identifier: Apache-2.0
"""Commands of a page, which are checked against a table before they are carried out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from sys import float_info
from typing import Any

_NUMBER = (int, float)
#: Types of the fields of each command. Every field is optional.
COMMANDS: dict[str, dict[str, type | tuple[type, ...]]] = {
    'set': {'key': str, 'value': (bool, int, float)},
    'choose': {'what': str, 'value': str},
    'poles': {'of': str, 'poles': list},
    'push': {'input': int, 'share': _NUMBER, 'shares': list},
    'path': {'points': list},
    'carry': {'names': list, 'values': list},
    'place': {'sensor': str, 'x': _NUMBER, 'y': _NUMBER},
    'limit': {'of': str, 'name': str, 'side': str, 'value': _NUMBER},
    'mode': {'lockstep': bool, 'paused': bool},
    'speed': {'value': _NUMBER},
    'step': {'reading': str},
    'ghost': {'filter': str, 'shown': bool},
    **{do: {} for do in ('reset', 'pause', 'resume', 'restart')},
}
#: Largest magnitude of the integers that JavaScript represents exactly.
_EXACT = 2**53


def are_numbers(values: Any, count: int, most: float) -> bool:
    """Return whether a field is a list of ``count`` numbers, none of them larger than ``most``."""
    within = isinstance(values, list) and len(values) == count
    return within and all(type(value) in _NUMBER and abs(value) <= most for value in values)


@dataclass(frozen=True)
class Command:
    """A request of a tab.

    Parameters
    ----------
    do
        Name of the command, one of `COMMANDS`; '' for an invalid request.
    fields
        Fields of the command, of the types in `COMMANDS`.
    number
        Number by which the tab recognises the answer.
    error
        Reason for which the request cannot be carried out; '' if it can.
    """

    do: str
    fields: Mapping[str, Any] = field(default_factory=dict)
    number: int | None = None
    error: str = ''


def read_command(text: str | bytes) -> Command | None:
    """Return the command in a text frame; None if the frame is not a JSON object."""
    try:
        request = json.loads(text, parse_constant=_ros_number, parse_float=_ros_number)
    except (ValueError, RecursionError):
        return None
    if not isinstance(request, dict):
        return None
    do, number = request.pop('do', None), request.pop('n', None)
    if type(number) is not int or abs(number) > _EXACT:
        number = None
    if not isinstance(do, str) or do not in COMMANDS:
        return Command('', number=number, error=f'unknown command {_excerpt(do)}')
    for name, value in request.items():
        kind = COMMANDS[do].get(name)
        if kind is None:
            return Command('', number=number, error=f'{do}: unknown field {_excerpt(name)}')
        # in Python a truth value is an int, but here it is not a number
        if not isinstance(value, kind) or (isinstance(value, bool) and not _allows(kind, bool)):
            return Command('', number=number, error=f'{do}: {name} cannot be {_excerpt(value)}')
    return Command(do, request, number)


def _allows(kind: type | tuple[type, ...], type_: type) -> bool:
    return type_ in (kind if isinstance(kind, tuple) else (kind,))


def _ros_number(text: str) -> float | None:
    """Return a number that ROS can read: None if it is not finite, 0 if it is subnormal."""
    value = float(text)
    if not isfinite(value):
        return None
    return value if abs(value) >= float_info.min else 0.0


def _excerpt(value: object) -> str:
    return json.dumps(value)[:60]
