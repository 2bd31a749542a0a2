# SPDX-License-Identifier: Apache-2.0
"""The numbers that an object computes with, as a vector: formulas hold for any values of them.

Zeros stay zeros, so that formulas have no terms for what is absent. Numbers that a function has
from where it was defined, its closure and defaults, count as well, if its formulas can be recorded
with symbols in their place.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import suppress
from copy import copy
from types import FunctionType
from typing import Any, TypeVar

import numpy as np

from kalman_ros.core import Array, Dynamics, Sensor

from .scalars import NOTHING, methods, of_symbols, read, rebound, scope
from .untraceable import UntraceableError

T = TypeVar('T')


class Parameters:
    """The floats and arrays among the attributes of a model or a sensor, nested ones included.

    They are equal where the same formulas hold, whatever the numbers.

    Parameters
    ----------
    original
        The model or sensor.
    opened
        Whether the numbers within its functions count, too.
    scoped
        Whether functions get global names that take symbols, as `scalars` has them.
    """

    def __init__(
        self, original: Dynamics | Sensor, *, opened: bool = False, scoped: bool = True
    ) -> None:
        #: The model or sensor.
        self.original = original
        self._opened, self._scoped = opened, scoped
        values = [*_numbers(original, opened)]
        #: The numbers, in the order of the attributes (p,).
        self.values: Array = np.array([value for value in values if isinstance(value, float)])
        #: Equal for objects that compute by the same formulas.
        self.signature: tuple[Hashable, ...] = (
            *(float if isinstance(value, float) else value for value in values),
            *read(original),
        )

    @property
    def comparable(self) -> bool:
        """Whether another object that is built in the same way has the same signature."""
        return not any(isinstance(item, _Same) for item in self.signature)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Parameters) and other.signature == self.signature

    def __hash__(self) -> int:
        return hash(self.signature)

    def applied(self, values: Any) -> Any:
        """Return a copy of the object with other numbers (p,), which may be symbols."""
        return _Replacement(iter(values), self._opened, self._scoped)(self.original)


#: Signatures of objects whose functions take no symbols in place of their numbers, and how many
#: are kept.
_closed: set[tuple[Hashable, ...]] = set()
_MOST_CLOSED = 256


def freed(original: Dynamics | Sensor, use: Callable[[Parameters], T]) -> tuple[Parameters, T]:
    """Return the parameters of an object and what is made of them.

    Functions keep their numbers if nothing can be made with these as parameters, as where one
    counts with a number, and their global names if others do not serve.
    """
    opened, whole = Parameters(original, opened=True), Parameters(original)
    can = opened.comparable and opened.signature != whole.signature
    if can and opened.signature not in _closed:
        try:
            return opened, use(opened)
        except (Exception, UntraceableError):  # functions of a user fail in any way
            if len(_closed) >= _MOST_CLOSED:
                _closed.clear()
            _closed.add(opened.signature)
    try:
        return whole, use(whole)
    except (Exception, UntraceableError) as error:
        plain = Parameters(original, scoped=False)
        with suppress(Exception, UntraceableError):
            return plain, use(plain)
        raise error


#: The marker of a number that is zero.
_ZERO = object()


def _numbers(value: Any, opened: bool, inside: tuple[Any, ...] = ()) -> Iterator[Any]:
    """Yield the numbers that are no zeros as floats, and all else as what can be compared."""
    if isinstance(value, (Dynamics, Sensor)) or (opened and hasattr(value, 'HAS_FUNCTION')):
        yield type(value)
        for name, attribute in vars(value).items():
            yield name
            yield from _numbers(attribute, opened, inside)
    elif opened and _can_open(value, inside):
        yield value.__code__, id(value.__globals__)
        yield from _numbers(_content(value), opened, (*inside, value))
    elif isinstance(value, np.ndarray) and value.dtype == float:
        yield value.shape
        for number in value.ravel().tolist():
            yield number or _ZERO
    elif isinstance(value, np.ndarray) and value.dtype.kind in 'iub':  # indices are no parameters
        yield value.dtype, value.shape, value.tobytes()
    elif isinstance(value, slice):
        yield slice, value.start, value.stop, value.step
    elif isinstance(value, (tuple, list)):
        yield type(value), len(value)
        for element in value:
            yield from _numbers(element, opened, inside)
    elif isinstance(value, dict):
        yield dict, len(value)
        for name, element in value.items():
            yield name
            yield from _numbers(element, opened, inside)
    elif isinstance(value, float):
        yield value or _ZERO
    else:
        yield value if _is_hashable(value) else _Same(value)


class _Replacement:
    """Copies with the numbers that `_numbers` yields replaced by others, in turn."""

    def __init__(self, numbers: Iterator[Any], opened: bool, scoped: bool) -> None:
        self._numbers, self._opened, self._scoped = numbers, opened, scoped

    def __call__(self, value: Any, inside: Mapping[int, Any] = NOTHING) -> Any:
        """Return a copy of a value that is within functions."""
        if isinstance(value, (Dynamics, Sensor)):
            return self._copied(value, inside)
        if hasattr(value, 'HAS_FUNCTION'):
            return self._copied(value, inside) if self._opened else self._with_functions(value)
        if id(value) in inside:
            return inside[id(value)]
        if self._opened and _can_open(value, ()):
            other = rebound(value, scope(value.__globals__))
            cells, defaults, named = self(_content(value), {**inside, id(value): other})
            for cell, content in zip(other.__closure__ or (), cells):
                cell.cell_contents = content
            other.__defaults__, other.__kwdefaults__ = tuple(defaults), named
            return other
        if isinstance(value, np.ndarray) and value.dtype == float:
            flat = [next(self._numbers) if number else 0.0 for number in value.ravel().tolist()]
            whole = np.empty(len(flat), dtype=object)
            whole[:] = flat
            plain = all(isinstance(number, float) for number in flat)
            return (whole.astype(float) if plain else whole).reshape(value.shape)
        if isinstance(value, dict):
            return {name: self(part, inside) for name, part in value.items()}
        if isinstance(value, (list, tuple)):
            parts = [self(part, inside) for part in value]
            return type(value)(*parts) if hasattr(value, '_fields') else type(value)(parts)
        if isinstance(value, float):
            return next(self._numbers) if value else value
        return of_symbols(value) if self._opened else value

    def _copied(self, value: Any, inside: Mapping[int, Any]) -> Any:
        other = copy(value)
        vars(other).update({name: self(part, inside) for name, part in vars(value).items()})
        if self._scoped:
            vars(other).update(methods(other))
        return other

    def _with_functions(self, value: Any) -> Any:
        """Return a copy with functions for symbols, which keep their numbers."""
        other = copy(value)
        if self._scoped:
            vars(other).update({name: of_symbols(part) for name, part in vars(value).items()})
        return other


def _can_open(value: Any, inside: tuple[Any, ...]) -> bool:
    """Return whether a value is a function whose content can be had, and not one of these."""
    if not isinstance(value, FunctionType) or any(value is function for function in inside):
        return False
    try:
        _content(value)
    except ValueError:  # a cell that is not set yet
        return False
    return True


def _content(function: FunctionType) -> tuple[list[Any], list[Any], dict[str, Any]]:
    """Return what a function has in its closure, as defaults, and as defaults by name."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return cells, [*(function.__defaults__ or ())], function.__kwdefaults__ or {}


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
