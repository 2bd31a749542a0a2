# SPDX-License-Identifier: Apache-2.0
"""The tables of a sweep, with one line for each point."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from rich.markup import escape
from rich.table import Table

from kalman_ros.core import Space
from kalman_ros.report.run_tables import plain_table

from .grid import Point
from .ranges import Range

#: Number of numeric columns that fit into 80 characters.
_MOST = 7


def sweep_tables(ranges: Sequence[Range], state: Space, points: Sequence[Point]) -> list[Table]:
    """Return values, cost, its theory, ANEES, lost runs and errors: first, and in more tables."""
    controlled = any(not isnan(point.cost) for point in points)
    with_theory = any(point.theory_cost is not None for point in points)
    columns = ['cost'] * controlled + ['theory'] * with_theory + ['ANEES', 'lost']
    first = max(1, _MOST + 1 - len(ranges) - len(columns))
    table = _beginning(ranges, columns)
    _head(table, state, range(min(first, state.size)))
    for point in points:
        cells = [f'{value:.4g}' for value in point.values]
        if point.refused:
            table.add_row(*cells, '[yellow]no design[/]')
            continue
        if controlled:
            cells.append(_number(point.cost))
        if with_theory:
            cells.append('' if point.theory_cost is None else f'{point.theory_cost:.4g}')
        anees = _number(point.anees)
        cells.append(anees if point.consistent else f'[yellow]{anees}*[/]')
        cells.append(f'[bold red]{100.0 * point.lost:.3g} %[/]' if point.lost else '0')
        cells += [_number(value) for value in point.rms[:first]]
        table.add_row(*cells)
    most = _MOST + 1 - len(ranges)
    starts = range(first, state.size, most)
    return [table, *(_errors(ranges, state, points, range(k, k + most)) for k in starts)]


def _errors(ranges: Sequence[Range], state: Space, points: Sequence[Point], which: range) -> Table:
    """Return the errors of more states; a point without a design has none."""
    table = _beginning(ranges, [])
    _head(table, state, range(which.start, min(which.stop, state.size)))
    for point in points:
        shown = [] if point.refused else point.rms[which.start : which.stop]
        table.add_row(*(f'{value:.4g}' for value in point.values), *map(_number, shown))
    return table


def _beginning(ranges: Sequence[Range], columns: Sequence[str]) -> Table:
    """Return an empty table with the swept values before the ``columns``."""
    names = [swept.label.split('.')[-1] for swept in ranges]
    if len({*names}) < len(names):
        names = [swept.label for swept in ranges]
    table = plain_table('', (*names[1:], *columns))
    table.columns[0].header = names[0]
    table.columns[0].justify = 'right'
    return table


def _head(table: Table, state: Space, which: range) -> None:
    for k in which:
        unit = f'\n\\[{state.units[k]}]' if state.units[k] else ''
        table.add_column(f'{escape(state.names[k])}{unit}', justify='right', no_wrap=True)


def _number(value: float) -> str:
    return '' if isnan(value) else f'{value:.3g}'
