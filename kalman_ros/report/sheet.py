# SPDX-License-Identifier: Apache-2.0
"""Tables that keep every digit: columns that do not fit go below."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from .run_tables import plain_table


@dataclass(frozen=True)
class Sheet:
    """Rows by name, and columns of cells by title.

    Parameters
    ----------
    names
        Of the rows.
    columns
        Title and cells.
    """

    names: Sequence[str]
    columns: Sequence[tuple[str, Sequence[str]]]

    def tables(self, console: Console) -> Iterator[Table]:
        """Yield the sheet in as many tables, one below the other, as the width requires."""
        at = 0
        while at < len(self.columns):
            end = at + 1
            while end < len(self.columns) and self._fits(console, at, end + 1):
                end += 1
            yield self._table(at, end)
            at = end

    def _fits(self, console: Console, start: int, end: int) -> bool:
        # its natural width, which a narrow console would not report
        wide = console.options.update(max_width=10_000)
        found = console.measure(self._table(start, end), options=wide)
        return found.maximum <= console.width

    def _table(self, start: int, end: int) -> Table:
        table = plain_table('', [title for title, _ in self.columns[start:end]])
        # a name that is too long for any table is broken, but never a number
        table.columns[0].no_wrap, table.columns[0].overflow = False, 'fold'
        for index, name in enumerate(self.names):
            table.add_row(name, *(cells[index] for _, cells in self.columns[start:end]))
        return table


def show(console: Console, sheets: Iterable[tuple[str, Sheet]]) -> None:
    """Print all sheets that are not empty below their titles."""
    for title, sheet in sheets:
        if sheet.columns:
            console.print(f'\n[bold]{title}[/]')
            console.print(*sheet.tables(console), sep='\n\n')
