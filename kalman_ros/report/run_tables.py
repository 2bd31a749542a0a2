# SPDX-License-Identifier: Apache-2.0
"""Tables of checks for the terminal, and the same numbers for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, isnan
from typing import Any

from rich import box
from rich.table import Table

from kalman_ros.analysis.checks import Check


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """Return a table of the theory and the measurement of each check."""
    table = plain_table(title, ('theory', 'measured', 'allowed'))
    table.add_column('', no_wrap=True)
    table.columns[0].no_wrap = False  # a narrow terminal breaks names, not numbers
    for check in checks:
        if isinstance(check.expected, complex) and check.expected.imag < 0.0:
            continue  # the table shows its conjugate
        allowed = '' if isnan(check.low) else _interval(check.low, check.high)
        verdict = '[green]ok[/]' if check.passed else '[bold red]FAILS[/]'
        table.add_row(
            f'{check.name} \\[{check.unit}]' if check.unit else check.name,
            number(check.expected),
            number(check.measured),
            allowed,
            verdict if allowed else '',
        )
    return table


def _interval(low: float, high: float) -> str:
    return f'± {high:.3g}' if low == -high else f'{low:.3g} to {high:.3g}'


def pair_table(title: str, pair: Sequence[Sequence[Check]]) -> Table:
    """Return a table of the theory and the measurements of two runs, A and B."""
    heads = [f'{run}\n{kind}' for run in 'AB' for kind in ('theory', 'measured')]
    table = plain_table(title, heads)
    table.columns[0].no_wrap = False
    columns = [_by_name(checks) for checks in pair]
    for name in dict.fromkeys((*columns[0], *columns[1])):
        table.add_row(
            name[0], *(cell for column in columns for cell in column.get(name, ('', '')))
        )
    return table


def _by_name(checks: Sequence[Check]) -> dict[tuple[str, int], tuple[str, str]]:
    """Return theory and measurement by name and number of repetition of the name."""
    cells: dict[tuple[str, int], tuple[str, str]] = {}
    for check in checks:
        if isinstance(check.expected, complex) and check.expected.imag < 0.0:
            continue  # the table shows its conjugate
        name = f'{check.name} \\[{check.unit}]' if check.unit else check.name
        repetition = sum(key[0] == name for key in cells)
        measured = number(check.measured)
        if check.counts and not check.passed:
            measured = f'[bold red]{measured}[/]'
        cells[name, repetition] = number(check.expected), measured
    return cells


def verdict(checks: Sequence[Check], claim: str) -> str:
    """Return the verdict: PASS or FAIL, the count, and the ``claim`` or the failed checks."""
    counted = [check for check in checks if check.counts]
    failed = [check.name for check in counted if not check.passed]
    count = f'{len(counted) - len(failed)} of {len(counted)} checks'
    if not failed:
        return f'[green]PASS, {count}:[/] {claim}'
    names = ', '.join(dict.fromkeys(failed))
    return f'[bold red]FAIL, {count} hold:[/] theory and measurement disagree on {names}'


def plain_table(title: str, columns: Sequence[str], words: int = 0) -> Table:
    """Return an empty table with a column of names and ``columns`` of numbers; '' is no title.

    The first ``words`` columns, that of names included, are of words: one that is too long is
    broken, but never a number.
    """
    table = Table(
        title=title or None,
        title_justify='left',
        title_style='bold',
        box=box.HORIZONTALS,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column('', no_wrap=True)
    for column in columns:
        table.add_column(column, justify='right', no_wrap=True)
    for table_column in table.columns[:words]:
        table_column.no_wrap, table_column.overflow, table_column.justify = False, 'fold', 'left'
    return table


def number(value: complex) -> str:
    """Return a real number, or a conjugate pair of complex numbers, as text."""
    if isinstance(value, complex):
        if abs(value.imag) < 1e-9:
            return f'{value.real:.2f}'
        return f'{value.real:.2f} ± {abs(value.imag):.2f}j'
    return '' if isnan(value) else f'{value:.4g}'


def checks_json(checks: Sequence[Check]) -> list[dict[str, Any]]:
    """Return the checks for ``summary.json``; a complex number is [real, imaginary]."""
    return [
        {
            'name': check.name,
            'unit': check.unit,
            'theory': plain(check.expected),
            'measured': plain(check.measured),
            'low': plain(check.low),
            'high': plain(check.high),
            'passed': bool(check.passed),
        }
        for check in checks
    ]


def plain(value: Any) -> Any:
    """Return a value for JSON: a complex number as a pair, a non-finite number as None."""
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    return value
