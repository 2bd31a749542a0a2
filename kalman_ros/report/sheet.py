# SPDX-License-Identifier: Apache-2.0
"""Tables that keep every digit and continue below if columns do not fit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from .run_tables import plain_table


@dataclass(frozen=True)
class Sheet:
    """A table of named rows and titled columns.

    Parameters
    ----------
    names
        Names of the rows.
    columns
        Title and cells of each column.
    """

    names: Sequence[str]
    columns: Sequence[tuple[str, Sequence[str]]]

    def tables(self, console: Console) -> Iterator[Table]:
        """Yield the sheet as one table, or as several tables if the console is too narrow."""
        start = 0
        while start < len(self.columns):
            end = start + 1
            while end < len(self.columns) and self._fits(console, start, end + 1):
                end += 1
            yield self._table(start, end)
            start = end

    def _fits(self, console: Console, start: int, end: int) -> bool:
        # a wide console reports the natural width of the table
        options = console.options.update(max_width=10_000)
        measurement = console.measure(self._table(start, end), options=options)
        return measurement.maximum <= console.width

    def _table(self, start: int, end: int) -> Table:
        table = plain_table('', [title for title, _ in self.columns[start:end]], 1)
        for index, name in enumerate(self.names):
            table.add_row(name, *(cells[index] for _, cells in self.columns[start:end]))
        return table


def show(console: Console, sheets: Iterable[tuple[str, Sheet]]) -> None:
    """Print all sheets that are not empty, each below its title."""
    for title, sheet in sheets:
        if sheet.columns:
            console.print(f'\n[bold]{title}[/]')
            console.print(*sheet.tables(console), sep='\n\n')
