# SPDX-License-Identifier: Apache-2.0
"""What message fields are declared to hold, and how a real number becomes one of theirs."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import isnan

_REAL = ('double', 'float')
_WHOLE = {f'int{bits}': (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)}
_WHOLE.update({f'uint{bits}': (0, 2**bits - 1) for bits in (8, 16, 32, 64)})
_ARRAY = re.compile(r'^(?:sequence<([^,>]+)(?:, (\d+))?>|([^\[]+)\[(\d+)\])$')


def number_kind(declared: str) -> str:
    """Return the kind of number of a field that is declared so; '' if it is none."""
    return declared if declared in (*_REAL, *_WHOLE, 'boolean') else ''


def array_of(declared: str) -> tuple[str, int | None]:
    """Return what an array that is declared so holds, and how many; '' if it is no array.

    None stands for any number of them.
    """
    match = _ARRAY.match(declared)
    if match is None:
        return '', None
    most = match[2] or match[4]
    return match[1] or match[3], None if most is None else int(most)


def converter(kind: str) -> Callable[[float], float | int | bool] | None:
    """Return what makes a real number one of a kind, the nearest; None if it is one already.

    What is no number becomes 0 where there are only whole ones.
    """
    if kind in _REAL:
        return None
    if kind == 'boolean':
        return lambda value: value >= 0.5
    low, high = _WHOLE[kind]

    def nearest(value: float) -> int:
        return 0 if isnan(value) else round(min(max(value, low), high))

    return nearest
