# SPDX-License-Identifier: Apache-2.0
"""The fault matrix as a table for the terminal, and as a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from rich.table import Table

from kalman_ros.report.run_tables import plain_table

from .findings import Finding

_COLUMNS = (
    'filter',
    'max error [m]',
    'coverage',
    'in',
    'fused',
    'rejected',
    'dropped',
    'recovery [s]',
    'warned',
)


def fault_table(findings: Sequence[Finding]) -> Table:
    """Return a table of all faults and filters."""
    table = plain_table('', ('error', 'covered', 'in = f. + rej. + dropped', 'recovery', ''))
    table.columns[0].no_wrap = False
    for found, filters in _alike(findings):
        error, coverage, came, *fates, recovery, warned = _cells(found)
        verdict = '[bold red]BROKEN[/]' if found.broken else '[green]ok[/]'
        table.add_row(
            f'{found.fault} \\[{filters}]',
            error,
            coverage,
            f'{came} = {" + ".join(fates)}',
            recovery,
            f'{verdict} [yellow]![/]' if warned else f'{verdict}  ',
        )
    return table


def fault_page(findings: Sequence[Finding], command: str, machine: str, about: str) -> str:
    """Return the page in Markdown: how it was made, how to read it, and the table."""
    broken = sum(bool(found.broken) for found in findings)
    lines = [
        '# What faults do to the loop',
        '',
        f'Made by `{command}` on {machine}. {about}',
        '',
        *_LEGEND,
        '',
        f'Of {len(findings)} runs {broken or "none"} broke a promise.',
        '',
        f'| fault | promise | {" | ".join(_COLUMNS)} |',
        f'|---|---|---|{"--:|" * (len(_COLUMNS) - 1)}',
        *(
            f'| {found.fault} | {found.promise.name.lower()} | {filters} | '
            f'{" | ".join(_cells(found))} |'
            for found, filters in _alike(findings)
        ),
    ]
    return '\n'.join(lines) + '\n'


_LEGEND = (
    'Every run promises: the loop is stable, no value from estimator or controller is NaN or',
    'infinite, and every published reading is received and either fused, rejected or dropped.',
    'Beyond that:',
    '',
    '* *covered*: the covariance covers the error, since the filter can see that readings are',
    '  missing, late, repeated or invalid.',
    '* *warned*: no filter can cover an unknown fault like this, but its innovations show it:',
    '  there is a warning on `/diagnostics`. The error is bounded.',
    '* *bounded*: the error is bounded; the fault is too small or hidden for a warning.',
    '',
    'Max error is the largest error of a position, coverage the share of steps whose normalised',
    'error (NEES) is below its 99 % quantile, both since the fault began. Recovery is the time',
    'from the end of the fault until every error is within 3 standard deviations for good; a',
    'consistent filter leaves them by chance, too: see *none*. A dash: the fault does not end.',
    'All runs have the same noise, and filters with the same numbers share a line: on a',
    'linear system KF, EKF and UKF are the same filter.',
)


def _alike(findings: Sequence[Finding]) -> Iterator[tuple[Finding, str]]:
    """Yield the findings of each fault, one for all filters with the same numbers."""
    for _, same in groupby(findings, lambda found: (found.fault, found.broken, _cells(found))):
        first, *others = same
        yield first, ', '.join(found.filter for found in (first, *others))


def _cells(found: Finding) -> list[str]:
    counts = found.counts
    return [
        f'{found.max_error:.3f}',
        f'{found.coverage:.3f}',
        *(str(n) for n in (counts.came, counts.fused, counts.rejected, counts.dropped)),
        '—' if found.recovery is None else f'{found.recovery:.2f}',
        'yes' if found.warned else '',
    ]
