# SPDX-License-Identifier: Apache-2.0
"""The numbers that an object computes with, as a vector: formulas hold for any values of them.

Zeros stay zeros, so that formulas have no terms for what is absent.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from copy import copy
from typing import Any

import numpy as np

from kalman_ros.core import Array, Model, Sensor


class Parameters:
    """The floats and arrays among the attributes of a model or a sensor, nested ones included.

    They are equal where the same formulas hold, whatever the numbers.

    Parameters
    ----------
    original
        The model or sensor.
    """

    def __init__(self, original: Model | Sensor) -> None:
        #: The model or sensor.
        self.original = original
        found = [*_numbers(original)]
        #: The numbers, in the order of the attributes (p,).
        self.values: Array = np.array([value for value in found if isinstance(value, float)])
        #: Equal for objects that compute by the same formulas.
        self.signature: tuple[Hashable, ...] = tuple(
            float if isinstance(value, float) else value for value in found
        )

    @property
    def comparable(self) -> bool:
        """Whether another object that is built in the same way has the same signature."""
        return not any(isinstance(each, _Same) for each in self.signature)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Parameters) and other.signature == self.signature

    def __hash__(self) -> int:
        return hash(self.signature)

    def applied(self, values: Any) -> Any:
        """Return a copy of the object with other numbers (p,), which may be symbols."""
        return _replaced(self.original, iter(values))


#: The marker of a number that is zero.
_ZERO = object()


def _numbers(value: Any) -> Iterator[Any]:
    """Yield the numbers that are no zeros as floats, and all else as what can be compared."""
    if isinstance(value, (Model, Sensor)):
        yield type(value)
        for name, attribute in vars(value).items():
            yield name
            yield from _numbers(attribute)
    elif isinstance(value, np.ndarray) and value.dtype == float:
        yield value.shape
        for each in value.ravel().tolist():
            yield each or _ZERO
    elif isinstance(value, (tuple, list)):
        yield type(value), len(value)
        for each in value:
            yield from _numbers(each)
    elif isinstance(value, dict):
        yield dict, len(value)
        for name, each in value.items():
            yield name
            yield from _numbers(each)
    elif isinstance(value, float):
        yield value or _ZERO
    else:
        yield value if _is_hashable(value) else _Same(value)


def _replaced(value: Any, numbers: Iterator[Any]) -> Any:
    """Return a value with the numbers that `_numbers` yields replaced by others."""
    if isinstance(value, (Model, Sensor)):
        other = copy(value)
        vars(other).update({k: _replaced(each, numbers) for k, each in vars(value).items()})
        return other
    if isinstance(value, np.ndarray) and value.dtype == float:
        flat = [next(numbers) if each else 0.0 for each in value.ravel().tolist()]
        whole = np.empty(len(flat), dtype=object)
        whole[:] = flat
        plain = all(isinstance(each, float) for each in flat)
        return (whole.astype(float) if plain else whole).reshape(value.shape)
    if isinstance(value, dict):
        return {name: _replaced(each, numbers) for name, each in value.items()}
    if isinstance(value, list):
        return [_replaced(each, numbers) for each in value]
    if isinstance(value, tuple):
        each = (_replaced(each, numbers) for each in value)
        return type(value)(*each) if hasattr(value, '_fields') else tuple(each)
    if isinstance(value, float):
        return next(numbers) if value else value
    return value


class _Same:
    """A value that is only equal to itself, kept alive so that no other one has its identity."""

    def __init__(self, value: Any) -> None:
        self._value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other._value is self._value

    def __hash__(self) -> int:
        return id(self._value)


def _is_hashable(value: Any) -> bool:
    try:
        hash(value)
    except TypeError:
        return False
    return True
