# SPDX-License-Identifier: Apache-2.0
"""An object whose class puts another one in front: it keeps all that it is and has."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import lru_cache
from typing import Any


@lru_cache(maxsize=256)
def _class(part: type, kind: Any) -> type:
    about = {'__module__': kind.__module__, '__doc__': kind.__doc__}
    return type(kind.__name__, (Derived, part, kind), about)


class Derived:
    """An object with compiled functions; in another process they are compiled there."""

    #: What computes.
    arithmetic: Any
    _c_again: tuple[Callable[..., Any], tuple[Any, ...]]

    def __copy__(self) -> Any:
        """Return another object with the same functions."""
        other = object.__new__(type(self))
        vars(other).update(vars(self))
        return other

    def __reduce__(self) -> Any:
        """Return how to compile the original, as it is now."""
        again, (original, *rest) = self._c_again
        now = copy(original)
        for name, value in vars(self).items():
            if name in vars(original) and not isinstance(value, Derived):
                vars(now)[name] = value
        return again, (now, *rest)


def derive(
    part: type, original: Any, again: Callable[..., Any], *rest: Any, **attributes: Any
) -> Any:
    """Return a copy of an object with the class ``part`` in front of its class.

    Parameters
    ----------
    part
        Whose functions it gets.
    original
        The object.
    again, rest
        What makes the copy in another process: ``again(original, *rest)``.
    attributes
        What the functions need.
    """
    kind: Any = type(original)
    derived: Any = object.__new__(_class(part, kind))
    vars(derived).update(vars(original), _c_again=(again, (original, *rest)), **attributes)
    return derived
