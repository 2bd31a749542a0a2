# SPDX-License-Identifier: Apache-2.0
"""Names of a parameter file that become C: identifiers, or refused."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from .loop import Loop

_KEYWORDS = set(
    # those of C, and what C++ adds, since it may read the header
    """
    auto break case char const continue default do double else enum extern float for goto if
    inline int long register restrict return short signed sizeof static struct switch typedef
    union unsigned void volatile while _Bool _Complex _Imaginary alignas alignof and and_eq asm
    bitand bitor bool catch class compl concept const_cast constexpr decltype delete
    dynamic_cast explicit export false friend mutable namespace new noexcept not not_eq nullptr
    operator or or_eq private protected public reinterpret_cast requires static_assert
    static_cast template this thread_local throw true try typeid typename using virtual wchar_t
    xor xor_eq
    """.split()  # noqa: SIM905
)
#: Names of files that an exported folder or a compiler has.
_FILES = set(
    """
    GNUmakefile Makefile makefile assert check complex ctype errno fenv float inttypes iso646
    limits locale math setjmp signal stdarg stdbool stddef stdint stdio stdlib string tgmath
    time wchar wctype
    """.split()  # noqa: SIM905
)
_IDENTIFIER = re.compile(r'[A-Za-z][A-Za-z0-9_]{0,62}', re.ASCII)
_PART = re.compile(r'[A-Za-z0-9_]{1,60}', re.ASCII)
_IN_A_COMMENT = re.compile(r'[^ -~]|\*/|/\*|//|\\')


def identifier(argument: str, name: str) -> str:
    """Return a name that C takes; ValueError, which names the argument, if it does not."""
    if name in _KEYWORDS:
        raise ValueError(f"{argument}: expected a name for C, got '{name}', which is a keyword")
    if not _IDENTIFIER.fullmatch(name):
        rule = 'a letter, and up to 62 letters, digits and _'
        raise ValueError(f'{argument}: expected a name for C ({rule}), got {name!a}')
    return name


def part(argument: str, name: str) -> str:
    """Return what follows an underscore in an identifier; a dot becomes another underscore."""
    suffix = name.replace('.', '_')
    if not _PART.fullmatch(suffix):
        rule = 'up to 60 letters, digits and _'
        raise ValueError(f'{argument}: expected a name for C ({rule}), got {name!a}')
    return suffix


def comment(text: str) -> str:
    """Return a text that cannot end a comment, in printable ASCII on one line."""
    return _IN_A_COMMENT.sub('?', text)


@dataclass(frozen=True)
class Names:
    """The names of a loop in C.

    Parameters
    ----------
    name
        The beginning of every public name.
    sensors, states, inputs
        What follows it, by name in the scenario.
    """

    name: str
    sensors: dict[str, str]
    states: dict[str, str]
    inputs: dict[str, str]

    @classmethod
    def of(cls, loop: Loop, name: str) -> Names:
        """Return the names of a loop.

        Raises
        ------
        ValueError
            If C does not accept one, or two are the same there.
        """
        if name in _FILES:
            raise ValueError(f"name: expected another than '{name}', which is a file of C")
        return cls(
            identifier('name', name),
            _parts('sensors', loop.sensors),
            _parts('states', loop.space.names),
            _parts('inputs', loop.scenario.model.input.names),
        )

    @classmethod
    def by_number(cls, loop: Loop, name: str) -> Names:
        """Return names that C takes, whatever those of the scenario are."""
        listed = loop.sensors, loop.space.names, loop.scenario.model.input.names
        suffixes = ({label: f'n{k}' for k, label in enumerate(names)} for names in listed)
        return cls(name, *suffixes)


def _parts(argument: str, names: Iterable[str]) -> dict[str, str]:
    suffixes: dict[str, str] = {}
    for name in names:
        suffix = part(argument, name)
        if suffix in suffixes.values():
            raise ValueError(f"{argument}: expected names that differ in C, got '{suffix}' twice")
        suffixes[name] = suffix
    return suffixes
