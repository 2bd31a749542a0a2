# SPDX-License-Identifier: Apache-2.0
"""Tables for the terminal, and the same numbers for machines."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, isnan
from typing import Any

from rich.table import Table

from kalman_ros.simulation.verdicts import Check


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """Return a table of theory beside measurement."""
    table = Table(title=title, title_justify='left', title_style='bold')
    table.add_column('quantity')
    table.add_column('theory', justify='right')
    table.add_column('measured', justify='right')
    table.add_column('allowed', justify='right')
    table.add_column('')
    for check in checks:
        allowed = '' if isnan(check.low) else f'{check.low:.4g} to {check.high:.4g}'
        verdict = '[green]ok[/]' if check.passed else '[bold red]FAILS[/]'
        table.add_row(
            f'{check.name} \\[{check.unit}]' if check.unit else check.name,
            number(check.expected),
            number(check.measured),
            allowed,
            verdict if allowed else '',
        )
    return table


def number(value: complex) -> str:
    """Return a real or complex number with four digits."""
    if isinstance(value, complex):
        if abs(value.imag) < 1e-9:
            return f'{value.real:.4g}'
        return f'{value.real:.3f} {"+" if value.imag > 0 else "-"} {abs(value.imag):.3f}j'
    return f'{value:.4g}'


def checks_json(checks: Sequence[Check]) -> list[dict[str, Any]]:
    """Return the same for ``summary.json``; a complex number is [real, imaginary]."""
    return [
        {
            'name': check.name,
            'unit': check.unit,
            'theory': _plain(check.expected),
            'measured': _plain(check.measured),
            'low': _plain(check.low),
            'high': _plain(check.high),
            'passed': bool(check.passed),
        }
        for check in checks
    ]


def _plain(value: complex) -> Any:
    if isinstance(value, complex):
        return [value.real, value.imag]
    return float(value) if isfinite(value) else None
