# SPDX-License-Identifier: Apache-2.0
"""Runs filters through the fault matrix on the real nodes and checks the promises."""

from __future__ import annotations

import argparse
import json
import os
import platform
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from kalman_ros.core import refuse_unknown
from kalman_ros.estimators import FILTERS
from kalman_ros.harness import NodeError
from kalman_ros.programs.refusal import refuse
from kalman_ros.programs.results import ready

from .cases import SHORT, Schedule
from .fault_settings import SETTINGS
from .findings import Finding
from .matrix import FaultMatrix


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog='faults', description=__doc__)
    parser.add_argument('--filters', nargs='+', default=['kf', 'ekf', 'ukf'], metavar='FILTER')
    parser.add_argument('--only', default='', metavar='TEXT', help='faults with TEXT in the name')
    parser.add_argument('--seed', type=int, default=1, help='of all noise (default: %(default)d)')
    parser.add_argument('--short', action='store_true', help='runs as short as those of the tests')
    parser.add_argument(
        '--out', type=Path, default=Path('out/faults'), metavar='DIR',
        help='for summary.json and faults.md (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--page', type=Path, metavar='FILE', help='where faults.md goes, if not there'
    )
    return parser.parse_args(argv)


def faults(options: argparse.Namespace, schedule: Schedule, console: Console) -> list[Finding]:
    """Return the finding of every fault and filter, fault by fault."""
    refuse_unknown(options.filters, FILTERS, 'filter')
    chosen = [
        (setting, filter, [case for case in setting.cases if options.only in case.name])
        for setting in SETTINGS
        for filter in options.filters
        if not setting.filters or filter in setting.filters
    ]
    if not any(cases for _, _, cases in chosen):
        raise ValueError(f"only: no fault has '{options.only}' in its name")
    ready(options.out)
    columns = (TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn())
    found: dict[str, list[Finding]] = {}
    with Progress(*columns, TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task('', total=sum(len(cases) for _, _, cases in chosen))
        for setting, filter, cases in chosen:
            if not cases:
                continue
            bar.update(task, description=f'{setting.scenario}, {filter}')
            matrix = FaultMatrix(filter, schedule, options.seed, setting)
            for finding in matrix.findings(cases, lambda: bar.advance(task)):
                found.setdefault(finding.fault, []).append(finding)
    return [finding for findings in found.values() for finding in findings]


def main(argv: Sequence[str] | None = None) -> None:
    """Run the matrix, print its table, write its results; exit 1 if a promise is broken."""
    options = arguments(argv)
    console = Console()
    schedule = SHORT if options.short else Schedule()
    start = time.monotonic()
    try:
        findings = faults(options, schedule, console)
    except (ValueError, NodeError, RuntimeError) as error:
        refuse('faults', error)
    wall = time.monotonic() - start
    _report(options, schedule, findings, wall, console)
    broken = [found for found in findings if found.broken]
    for found in broken:
        console.print(f'[bold red]{found.fault}, {found.filter}:[/] {"; ".join(found.broken)}')
    count = f'{len(findings) - len(broken)} of {len(findings)} runs'
    if broken:
        console.print(f'[bold red]FAIL, {count}[/]')
        sys.exit(1)
    console.print(f'[green]PASS, {count}:[/] Every promise holds.')


def _report(
    options: argparse.Namespace,
    schedule: Schedule,
    findings: Sequence[Finding],
    wall: float,
    console: Console,
) -> None:
    """Print and write the findings."""
    from .tables import fault_page, fault_table

    console.print(fault_table(findings))
    machine = f'{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}'
    scenarios = ', '.join(f'`{each.scenario}`' for each in SETTINGS)
    about = (
        f'{scenarios} in lockstep, seed {options.seed}; faults from {schedule.start:g} to '
        f'{schedule.end:g} s of {schedule.stop:g} s. {len(findings)} runs took {wall:.0f} s.'
    )
    summary = {
        'machine': machine,
        'seed': options.seed,
        'wall': wall,
        'schedule': vars(schedule),
        'findings': [found.summary() for found in findings],
    }
    (options.out / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    command = shlex.join(['./dev', 'faults', *sys.argv[1:]])
    page = options.page or options.out / 'faults.md'
    page.write_text(fault_page(findings, command, machine, about))
    console.print(f'{about} In {options.out}: summary.json; {page}', style='dim')
