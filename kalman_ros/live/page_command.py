# SPDX-License-Identifier: Apache-2.0
"""Commands of a page: what a tab sends, checked against a table before anything acts on it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from sys import float_info
from typing import Any

_NUMBER = (int, float)
#: Each command, and the types of its fields. A field may be left out.
COMMANDS: dict[str, dict[str, type | tuple[type, ...]]] = {
    'set': {'key': str, 'value': (bool, int, float)},
    'choose': {'what': str, 'value': str},
    'poles': {'of': str, 'poles': list},
    'push': {'input': int, 'share': _NUMBER},
    'mode': {'lockstep': bool, 'paused': bool},
    'speed': {'value': _NUMBER},
    **{do: {} for do in ('reset', 'pause', 'resume', 'step', 'restart')},
}
#: Integers that JavaScript represents exactly.
_EXACT = 2**53


@dataclass(frozen=True)
class Command:
    """One request of a tab.

    Parameters
    ----------
    do
        The name of the command, one of `COMMANDS`; '' where the request is wrong.
    fields
        Its fields, of the types in `COMMANDS`.
    number
        The number by which the tab recognises the answer.
    error
        Why the request cannot be carried out; '' if it can.
    """

    do: str
    fields: Mapping[str, Any] = field(default_factory=dict)
    number: int | None = None
    error: str = ''


def read_command(text: str | bytes) -> Command | None:
    """Return the request in a frame; None if the frame is not a JSON object."""
    try:
        given = json.loads(text, parse_constant=_finite, parse_float=_finite)
    except (ValueError, RecursionError):
        return None
    if not isinstance(given, dict):
        return None
    do, number = given.pop('do', None), given.pop('n', None)
    if type(number) is not int or abs(number) > _EXACT:
        number = None
    if not isinstance(do, str) or do not in COMMANDS:
        return Command('', number=number, error=f'unknown command {_shown(do)}')
    for name, value in given.items():
        kind = COMMANDS[do].get(name)
        if kind is None:
            return Command('', number=number, error=f'{do}: unknown field {_shown(name)}')
        # a truth value is an int in Python, and no number here
        if not isinstance(value, kind) or (isinstance(value, bool) and not _has(kind, bool)):
            return Command('', number=number, error=f'{do}: {name} cannot be {_shown(value)}')
    return Command(do, given, number)


def _has(kind: type | tuple[type, ...], wanted: type) -> bool:
    return wanted in (kind if isinstance(kind, tuple) else (kind,))


def _finite(text: str) -> float | None:
    """Return a number that ROS can read: None if it is not finite, 0 if it is subnormal."""
    value = float(text)
    if not isfinite(value):
        return None
    return value if abs(value) >= float_info.min else 0.0


def _shown(value: object) -> str:
    return json.dumps(value)[:60]
