# SPDX-License-Identifier: Apache-2.0
"""Runs studies: what the LQG argument claims, measured on the real nodes beside its theory."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from kalman_ros.core import refuse_unknown
from kalman_ros.harness import NodeError
from kalman_ros.harness.interrupts import deferred

from .results import ready
from .studies import STUDIES, Findings

#: What moves while a study runs.
_COLUMNS = SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn()


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the command line's options."""
    claims = '\n'.join(f'  {name:16}{claim(name)}' for name in STUDIES)
    parser = argparse.ArgumentParser(
        prog='study',
        description=f'{__doc__}\n\n{claims}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('names', nargs='*', default=['all'], help="studies, or 'all' (default)")
    parser.add_argument(
        '--out', type=Path, default=Path('out/studies'), metavar='DIR',
        help='for the results (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument('--size', type=float, default=1.0, help='less for a shorter look')
    return parser.parse_args(argv)


def claim(name: str) -> str:
    """Return what a study shows, in a sentence."""
    module = import_module(f'{__package__}.studies.{name}')
    return (module.__doc__ or '').partition('\n')[0]


def main(argv: Sequence[str] | None = None) -> None:
    """Run studies; exit 1 if theory and measurement disagree in one."""
    options = arguments(argv)
    console = Console()
    names = list(STUDIES) if options.names == ['all'] else options.names
    failed = []
    try:
        refuse_unknown(names, STUDIES, 'study')
        for number, name in enumerate(names, start=1):
            folder = ready(options.out / name)
            console.print(f'\n[bold]{name}[/] ({number} of {len(names)}): {claim(name)}')
            start = time.monotonic()
            with Progress(*_COLUMNS, console=console, transient=True) as bar:
                bar.add_task('running the nodes')
                findings = import_module(f'{__package__}.studies.{name}').study(options.size)
            _report(console, folder, findings, time.monotonic() - start)
            failed += [name] if not all(check.passed for check in findings.checks) else []
    except (ValueError, NodeError, RuntimeError) as error:
        print(f'study: {error}', file=sys.stderr)
        sys.exit(2)
    if failed:
        console.print(f'[bold red]Theory and measurement disagree:[/] {", ".join(failed)}')
        sys.exit(1)
    console.print('[green]Theory and measurement agree.[/]')


def _report(console: Console, folder: Path, findings: Findings, wall: float) -> None:
    """Print and write what a study found."""
    from kalman_ros.report import tables  # matplotlib loads while nothing waits

    console.print(tables.checks_table('', findings.checks))
    summary = {
        'study': folder.name,
        'wall': wall,
        'passed': all(check.passed for check in findings.checks),
        'checks': tables.checks_json(findings.checks),
        **findings.data,
    }
    # the summary last: where it is, all is whole
    with deferred():
        findings.draw(folder / f'{folder.name}.png')
        (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    console.print(f'{wall:.1f} s; in {folder}: summary.json, {folder.name}.png', style='dim')
