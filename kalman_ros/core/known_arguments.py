# SPDX-License-Identifier: Apache-2.0
"""Functions that answer a wrong argument with the right one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from inspect import signature
from typing import TypeVar

from .named_options import nearest

Function = TypeVar('Function', bound=Callable[..., object])


def knows_arguments(too_many: str = '', /, **elsewhere: str) -> Callable[[Function], Function]:
    """Return a decorator: a call that does not fit says what would.

    Parameters
    ----------
    too_many
        What to do with more positional arguments than there are.
    elsewhere
        Names that arguments have in other libraries, each with what it is here.
    """

    def decorate(function: Function) -> Function:
        @wraps(function)
        def call(*given: object, **named: object) -> object:
            try:
                return function(*given, **named)
            except TypeError as error:
                traceback = error.__traceback__
                inner = traceback.tb_next if traceback else None
                if inner is not None:  # within the function, which was called
                    raise
                many = too_many if ' given' in str(error) else ''
                words = _answer(function, named, elsewhere, many)
                raise TypeError(words or str(error)) from None

        return call  # type: ignore[return-value]

    return decorate


def _answer(
    function: Callable[..., object],
    named: Mapping[str, object],
    elsewhere: Mapping[str, str],
    too_many: str,
) -> str:
    """Return why arguments do not fit; '' if Python's words have to do."""
    known = [name for name in signature(function).parameters if name not in ('self', 'cls')]
    wrong = next((name for name in named if name not in known), '')
    name = function.__qualname__.partition('.')[0]
    if not wrong:
        return f'{name}: {too_many}' if too_many else ''
    if wrong in elsewhere:
        return f"{name} has no argument '{wrong}'; here it is {elsewhere[wrong]}"
    hint = nearest(wrong, known) or f'it has {", ".join(known)}'
    return f"{name} has no argument '{wrong}'; {hint}"
