# SPDX-License-Identifier: Apache-2.0
"""Tables that keep every digit: columns that do not fit beside each other go below."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from .tables import plain_table


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
        """Yield the sheet in as many tables, one below the other, as its width takes."""
        at = 0
        while at < len(self.columns):
            end = at + 1
            while end < len(self.columns) and self._fits(console, at, end + 1):
                end += 1
            yield self._table(at, end)
            at = end

    def _fits(self, console: Console, start: int, end: int) -> bool:
        # as wide as it would like to be, which a console that is narrow would not tell
        wide = console.options.update(max_width=10_000)
        found = console.measure(self._table(start, end), options=wide)
        return found.maximum <= console.width

    def _table(self, start: int, end: int) -> Table:
        table = plain_table('', [title for title, _ in self.columns[start:end]])
        # a name that is too long for any table is broken, where a number never is
        table.columns[0].no_wrap, table.columns[0].overflow = False, 'fold'
        for index, name in enumerate(self.names):
            table.add_row(name, *(cells[index] for _, cells in self.columns[start:end]))
        return table


def show(console: Console, sheets: Iterable[tuple[str, Sheet]]) -> None:
    """Print sheets below their titles, those that are not empty."""
    for title, sheet in sheets:
        if sheet.columns:
            console.print(f'\n[bold]{title}[/]')
            console.print(*sheet.tables(console), sep='\n\n')
