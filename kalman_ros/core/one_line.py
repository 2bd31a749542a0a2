# SPDX-License-Identifier: Apache-2.0
"""Messages to a person, in one line whatever they quote."""

from __future__ import annotations

#: The most characters of a line.
_LONGEST = 500


def one_line(text: str) -> str:
    """Return a text without line breaks and control characters.

    Long ones, for example with a quoted value, are shortened in the middle.
    """
    found = ''.join(map(_printable, text))
    return found if len(found) <= _LONGEST else f'{found[: _LONGEST - 100]} ... {found[-90:]}'


def _printable(character: str) -> str:
    return character if character.isprintable() else ascii(character)[1:-1]
