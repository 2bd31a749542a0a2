# SPDX-License-Identifier: Apache-2.0
"""The declared types of message fields, and conversion of real numbers to them."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import isnan

_REAL = ('double', 'float')
_WHOLE = {f'int{bits}': (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)}
_WHOLE.update({f'uint{bits}': (0, 2**bits - 1) for bits in (8, 16, 32, 64)})
_ARRAY = re.compile(r'^(?:sequence<([^,>]+)(?:, (\d+))?>|([^\[]+)\[(\d+)\])$')


def number_kind(declared: str) -> str:
    """Return the kind of number of a field by its declaration; '' if it is not a number."""
    return declared if declared in (*_REAL, *_WHOLE, 'boolean') else ''


def array_of(declared: str) -> tuple[str, int | None]:
    """Return the element type and size of an array by its declaration; '' if it is not an array.

    The size is None for a sequence of any length.
    """
    match = _ARRAY.match(declared)
    if match is None:
        return '', None
    most = match[2] or match[4]
    return match[1] or match[3], None if most is None else int(most)


def converter(kind: str) -> Callable[[float], float | int | bool] | None:
    """Return a conversion of real numbers to the nearest number of a kind; None if not needed.

    NaN becomes 0 for integers.
    """
    if kind in _REAL:
        return None
    if kind == 'boolean':
        return lambda value: value >= 0.5
    low, high = _WHOLE[kind]

    def nearest(value: float) -> int:
        return 0 if isnan(value) else round(min(max(value, low), high))

    return nearest
