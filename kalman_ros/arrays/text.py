# SPDX-License-Identifier: Apache-2.0
"""Numbers as plain text, for results that print their contents."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import wrap

import numpy as np

from kalman_ros.core import Array

#: The widest line, and the most columns of a matrix.
WIDTH = 79
_MOST_COLUMNS = 8
#: Share of the largest number of a matrix that rounding has.
ROUNDING = 1e-15


def number(value: complex) -> str:
    """Return a number with four digits."""
    if isinstance(value, complex) and value.imag:
        return f'{value.real:.4g} {"+" if value.imag > 0.0 else "-"} {abs(value.imag):.4g}j'
    return f'{value.real:.4g}'


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table: the first column left-aligned, the others right-aligned."""
    whole = [list(head), *map(list, rows)]
    widths = [max(len(row[column]) for row in whole) for column in range(len(head))]
    return [
        '  '.join(
            [row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:]))]
        ).rstrip()
        for row in whole
    ]


def matrix(rows: Sequence[str], columns: Sequence[str], values: Array) -> list[str]:
    """Return the lines of a matrix with its names, in parts if it is wide."""
    # what is less than the rounding of the largest number is printed as 0
    values = np.where(np.abs(values) < ROUNDING * np.max(np.abs(values), initial=0.0), 0.0, values)
    cells = [[name, *map(number, row)] for name, row in zip(columns, values.T.tolist())]
    widths = [2 + max(map(len, column)) for column in cells]
    room = WIDTH - max(map(len, rows), default=0)
    lines: list[str] = []
    start = 0
    while start < len(columns):
        fits = np.cumsum(widths[start : start + _MOST_COLUMNS]) <= room
        part = cells[start : start + max(int(np.count_nonzero(fits)), 1)]
        head, *body = zip(*part)
        lines += table(['', *head], ([name, *row] for name, row in zip(rows, body)))
        start += len(part)
    return lines


def sentence(line: str) -> list[str]:
    """Return a sentence wrapped to the width, with indented continuation lines."""
    return wrap(line, WIDTH, subsequent_indent='  ')


def clauses(line: str) -> list[str]:
    """Return a sentence wrapped as `sentence` does, but only after a comma."""
    kept = ', '.join(clause.replace(' ', '\0') for clause in line.split(', '))
    return [piece.replace('\0', ' ') for piece in sentence(kept)]


def poles(values: Iterable[complex]) -> str:
    """Return poles in one line, a complex pair as one."""
    shown = []
    for pole in np.asarray(list(values), dtype=complex).tolist():
        if abs(pole.imag) < 1e-12 * max(1.0, abs(pole)):
            shown.append(f'{pole.real:.4g}')
        elif pole.imag > 0.0:
            shown.append(f'{pole.real:.4g} ± {pole.imag:.4g}j')
    return ', '.join(shown)
