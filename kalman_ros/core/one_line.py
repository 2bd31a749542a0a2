# SPDX-License-Identifier: Apache-2.0
"""Messages to a person, in one line whatever they quote."""

from __future__ import annotations

#: Largest number of characters of a line.
_LONGEST = 500


def one_line(text: str, longest: int = _LONGEST) -> str:
    """Return a text without line breaks and control characters.

    Long texts, for example with a quoted value, are shortened in the middle.
    """
    # of a very long text, only the two ends are shown
    if len(text) > 2 * longest:
        text = text[:longest] + text[-longest:]
    line = text if text.isprintable() else ''.join(map(_printable, text))
    return line if len(line) <= longest else f'{line[: longest - 100]} ... {line[-90:]}'


def _printable(character: str) -> str:
    return character if character.isprintable() else ascii(character)[1:-1]
