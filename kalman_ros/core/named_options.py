# SPDX-License-Identifier: Apache-2.0
"""Options: named values with a default, a description and a range.

The options of a model, a sensor, a filter or a node are the keyword arguments of the callable
that builds it. ``Annotated[float, About('mass of the body', 'kg', minimum=0.0)]`` describes
one; ROS parameters, their descriptions and their ranges are derived from it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from difflib import get_close_matches
from functools import lru_cache
from math import inf
from reprlib import Repr
from typing import Any, Union, get_args, get_type_hints

import numpy as np

Value = Union[bool, int, float, str, list[float], list[str]]


@dataclass(frozen=True)
class About:
    """The description of an option: a sentence, its unit and range, and whether it is live.

    Options of one ``feature`` are omitted from a node's help while all have their defaults.
    """

    description: str
    unit: str = ''
    minimum: float = -inf
    maximum: float = inf
    live: bool = False
    feature: str = ''


@dataclass(frozen=True)
class Option:
    """A named value that a person may set."""

    name: str
    default: Value
    about: About

    @property
    def description(self) -> str:
        """Description with its unit."""
        unit = f' [{self.about.unit}]' if self.about.unit else ''
        return f'{self.about.description}{unit}'

    def check(self, value: Any) -> Value:
        """Return ``value`` in the type of the default; ValueError names the option.

        A whole number is accepted as a number, and a single item as a list of one.
        """
        value = _plain(value)
        if not isinstance(self.default, list):
            item: Value = self._check_item(self.default, value)
            return item
        several = hasattr(value, '__iter__') and not isinstance(value, str)
        items = list(value) if several else [value]
        sample = self.default[0] if self.default else 0.0
        return [self._check_item(sample, item) for item in items]  # type: ignore[return-value]

    def _check_item(self, sample: Any, value: Any) -> Any:
        value = _plain(value)
        if type(value) is int and not -_LARGEST <= value < _LARGEST:
            raise ValueError(
                f'{self.name}: expected a number of at most 64 bits, got a longer one'
            )
        if isinstance(sample, float) and type(value) is int:
            value = float(value)
        if type(value) is not type(sample):
            hint = _QUOTE if isinstance(sample, str) and isinstance(value, bool) else ''
            kind = _KINDS[type(sample)]
            raise ValueError(f'{self.name}: expected {kind}, got {brief(value)}{hint}')
        low, high = self.about.minimum, self.about.maximum
        if isinstance(value, (int, float)) and not low <= value <= high:
            expected = f'{low:g} to {high:g}'
            if high == inf:
                expected = 'a number' if low == -inf else f'at least {low:g}'
            elif low == -inf:
                expected = f'at most {high:g}'
            unit = self.about.unit
            expected = (
                f'{expected} {"in " if expected == "a number" else ""}{unit}' if unit else expected
            )
            raise ValueError(f'{self.name}: expected {expected}, got {value:g}')
        return value


def _plain(value: Any) -> Any:
    """Convert a numpy scalar or array to plain Python."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


#: YAML 1.1, which ROS uses, has many words for truth values.
_QUOTE = '; write a word such as y or no in quotes, or it is read as true or false'
#: Upper bound of the integers of ROS.
_LARGEST = 2**63

_brief = Repr()
_brief.maxlist = _brief.maxdict = 20
_brief.maxstring = _brief.maxother = 100
#: Return a value as an error message quotes it, shortened if it is long.
brief = _brief.repr

_KINDS = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a word'}


#: Largest number of known names that a message lists, if none of them is close.
_FEW = 8


def signature(function: Callable[..., Any]) -> inspect.Signature:
    """Return the signature of a callable; that of a function or a class is cached."""
    fixed = inspect.isroutine(function) or inspect.isclass(function)
    return _evaluated(function) if fixed else inspect.signature(function, eval_str=True)


@lru_cache(maxsize=256)
def _evaluated(function: Callable[..., Any]) -> inspect.Signature:
    parts = vars(function).get('__dataclass_params__') if is_dataclass(function) else None
    if parts is None or not parts.init:
        return inspect.signature(function, eval_str=True)
    # inherited fields are annotated with names of the module of their class
    bare, hints = inspect.signature(function), get_type_hints(function, include_extras=True)
    return bare.replace(
        parameters=[
            parameter.replace(annotation=hints.get(parameter.name, parameter.annotation))
            for parameter in bare.parameters.values()
        ]
    )


def options_of(build: Callable[..., Any], prefix: str = '') -> tuple[Option, ...]:
    """Return the options of a callable: its keyword arguments with a default.

    ``prefix`` goes before each name. An argument without `About` is described by its name.

    Raises
    ------
    ValueError
        If a default has a type that a ROS parameter cannot hold.
    """
    options = []
    for name, argument in signature(build).parameters.items():
        default = argument.default
        if default is inspect.Parameter.empty:
            continue
        if isinstance(default, (tuple, list)):
            if not default and 'str' in str(argument.annotation):  # items count as numbers
                raise ValueError(f"{name}: expected a default of words, such as ('',), got none")
            default = [_plain(item) for item in default]
        default = _plain(default)
        if not isinstance(default, (bool, int, float, str, list)):
            raise ValueError(f'{name}: a default must be a number, a word or a list of them')
        notes = [note for note in get_args(argument.annotation) if isinstance(note, About)]
        about = notes[0] if notes else About(name.replace('_', ' '))
        options.append(Option(prefix + name, default, about))
    return tuple(options)


def refuse_unknown(names: Iterable[str], known: Iterable[str], kind: str) -> None:
    """Raise ValueError for the first of ``names`` that is not ``known``; suggest the nearest."""
    known = dict.fromkeys(known)  # looked up by name, and in order
    for name in names:
        if name not in known:
            raise ValueError(f"unknown {kind} '{name}'{_hint(name, list(known))}")


def nearest(name: str, known: Iterable[str]) -> str:
    """Return "did you mean" with the nearest of the ``known`` names; '' if none is close.

    A name that ends with ``name``, after a dot, is nearest, and then one in another case.
    """
    known = list(known)
    whole = [option for option in known if option.endswith(f'.{name}')]
    whole = whole or [option for option in known if option.lower() == name.lower()]
    near = whole or get_close_matches(name, known, n=1)
    return f"did you mean '{near[0]}'?" if near else ''


def _hint(name: str, known: Sequence[str]) -> str:
    parts = [option for option in known if option.startswith(f'{name}.')]
    if parts:
        return f'; its parts are {", ".join(parts[:_FEW])}'
    question = nearest(name, known)
    if question:
        return f'; {question}'
    return f'; known are {", ".join(known)}' if 0 < len(known) <= _FEW else ''


def build_with(build: Callable[..., Any], values: Mapping[str, Value], *fixed: Any) -> Any:
    """Call ``build(*fixed, **values)``, with each value checked against its option first."""
    options = {option.name: option for option in options_of(build)}
    for name in values:
        if name not in options:
            raise ValueError(f'{name}: unknown option{_hint(name, list(options))}')
    return build(*fixed, **{name: options[name].check(value) for name, value in values.items()})
