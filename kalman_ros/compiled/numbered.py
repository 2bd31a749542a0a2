# SPDX-License-Identifier: Apache-2.0
"""The numbers of models and sensors whose functions are C, and the calls of these functions.

Each call writes its arguments into a new array, behind which C puts the results: no state
is shared, so that threads may share the objects.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import lru_cache
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space

#: The address of a buffer, and a buffer of an array.
address: Callable[[Any], int] = ctypes.addressof
memory: Callable[[Any], Any] = ctypes.c_char.from_buffer
POINTER, NUMBER, COUNT = ctypes.c_void_p, ctypes.c_double, ctypes.c_long


class Numbered:
    """The numbers of a model or a sensor, for the formulas of its library; or those of several."""

    arithmetic = 'C'
    #: Functions take leading axes.
    takes_leading_axes = True
    _c_library: Any
    _c_numbers: Array
    _c_p: int
    #: How many sets of numbers there are, for as many members in turn, and whose they are.
    _c_sets = 1
    _c_members: Sequence[Any] = ()

    def merged_numbers(self, others: Sequence[Any]) -> Any:
        """Return one object for states (..., p, n) of p objects; None if their formulas differ."""
        every = [self, *others]
        if not all(map(self._c_alike, every)):
            return None
        whole = copy(self)
        sets = [member._c_numbers[:-1] for member in every]
        if any(not np.array_equal(numbers, sets[0]) for numbers in sets):
            vars(whole).update(pointed(np.concatenate(sets)))
            whole._c_sets, whole._c_members = len(every), every
        return whole

    def _c_alike(self, other: Any) -> bool:
        return getattr(other, '_c_library', None) is self._c_library and other._c_sets == 1

    def _c_lost(self, results: Array, part: type) -> Iterator[tuple[int, Any]]:
        """Yield the members whose results (members, ...) are not finite, with their originals.

        The original functions are those behind a ``part`` of the class. An exact derivative may
        not exist where a function that looks at its numbers has one.
        """
        members = self._c_members or [self]
        for k in np.flatnonzero(
            ~np.isfinite(results).all(axis=(*range(1, results.ndim),))
        ).tolist():
            yield k, super(part, members[k % self._c_sets])


def hold(library: Any, name: str, result: Any, *arguments: Any) -> None:
    """Declare a function of a library that keeps the lock of the interpreter.

    To give that back and take it again takes longer than a step.
    """
    setattr(library, name, _kind(result, *arguments)(function_address(getattr(library, name))))


#: A type of functions that keep the lock, made once.
_kind: Any = lru_cache(ctypes.PYFUNCTYPE)


def declare(library: Any, name: str, *arguments: Any) -> None:
    """Declare a function of an array, a number of members, arguments, numbers and their sets."""
    hold(library, name, None, POINTER, COUNT, *arguments, POINTER, COUNT)


def function_address(function: Any) -> int:
    """Return the address of a function of a library; 0 for None."""
    return ctypes.cast(function, POINTER).value or 0 if function else 0


def pointed(numbers: Array) -> dict[str, Any]:
    """Return numbers, kept in memory, and their address."""
    kept = np.append(numbers, 0.0)  # none have no address
    return {'_c_numbers': kept, '_c_p': address(memory(kept))}


def turns(space: Space) -> Array:
    """Return a whole turn for each coordinate that is an angle, and 0 for the others."""
    return np.array([2.0 * np.pi if name in space.angles else 0.0 for name in space.names])


def reads(sensed: int, numbers: int, output: Space) -> dict[str, Any]:
    """Return what C needs of a sensor to read a state: addresses, and the turns behind one."""
    subtract, whole = function_address(getattr(output, '_c_subtract', None)), turns(output)
    return {'_c_turns': whole, '_c_reads': (sensed, numbers, subtract, address(memory(whole)))}
