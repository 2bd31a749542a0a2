# SPDX-License-Identifier: Apache-2.0
"""The table of a sweep, with one line for each point."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from rich.table import Table

from kalman_ros.report.run_tables import plain_table

from .grid import Point
from .ranges import Range

#: Number of numeric columns that fit into 80 characters.
_MOST = 7


def sweep_table(ranges: Sequence[Range], states: Sequence[str], points: Sequence[Point]) -> Table:
    """Return values, cost, its theory, ANEES, lost runs and the errors of the first states."""
    controlled = any(not isnan(point.cost) for point in points)
    with_theory = any(point.theory_cost is not None for point in points)
    columns = ['cost'] * controlled + ['theory'] * with_theory + ['ANEES', 'lost']
    shown = states[: max(1, _MOST + 1 - len(ranges) - len(columns))]
    names = [swept.label.split('.')[-1] for swept in ranges]
    if len({*names}) < len(names):
        names = [swept.label for swept in ranges]
    table = plain_table('', (*names[1:], *columns))
    table.columns[0].header = names[0]
    table.columns[0].justify = 'right'
    for name in shown:
        table.add_column(name, justify='right', no_wrap=True)
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
        cells += [_number(value) for value in point.rms[: len(shown)]]
        table.add_row(*cells)
    return table


def _number(value: float) -> str:
    return '' if isnan(value) else f'{value:.3g}'
