# SPDX-License-Identifier: Apache-2.0
"""Runs studies: claims of the LQG argument, measured on the real nodes."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from textwrap import fill, indent

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from kalman_ros.core import refuse_unknown
from kalman_ros.harness import NodeError
from kalman_ros.harness.interrupts import deferred
from kalman_ros.programs.refusal import refuse
from kalman_ros.programs.results import ready

from . import STUDIES, Findings, study_run

#: The columns of the progress bar.
_COLUMNS = SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn()


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the command line's options."""
    claims = indent('\n'.join(map(_listed, STUDIES)), '  ')
    parser = argparse.ArgumentParser(
        prog='study',
        description=f'{__doc__}\n\n{claims}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('names', nargs='*', help="studies, or 'all'; none: list them")
    parser.add_argument(
        '--out', type=Path, default=Path('out/studies'), metavar='DIR',
        help='for the results (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--size',
        type=float,
        default=1.0,
        help='1: the whole study, 0.3: a shorter one (default: 1)',
    )
    return parser.parse_args(argv)


def claim(name: str) -> str:
    """Return the claim of a study, which is the first line of its docstring."""
    module = import_module(f'{__package__}.{name}')
    return (module.__doc__ or '').partition('\n')[0]


def _listed(name: str) -> str:
    """Return the name of a study beside its claim, on lines that fit a terminal."""
    return fill(f'{name:16}{claim(name)}', 76, subsequent_indent=' ' * 16)


def main(argv: Sequence[str] | None = None) -> None:
    """Run studies, also after a failure; exit with the worst of their codes."""
    options = arguments(argv)
    console = Console()
    if not options.names:
        for name in STUDIES:
            console.print(_listed(name), highlight=False, soft_wrap=True)
        console.print('\nRun some with: study NAME ..., all with: study all')
        return
    names = list(STUDIES) if options.names == ['all'] else options.names
    try:
        refuse_unknown(names, STUDIES, 'study')
    except ValueError as error:
        refuse('study', error)
    outcomes = []
    for number, name in enumerate(names, start=1):
        console.print(f'\n[bold]{name}[/] ({number} of {len(names)}): {claim(name)}')
        outcomes.append(_run(name, options, console))
    _conclude(outcomes, console)


@dataclass(frozen=True)
class Outcome:
    """Outcome of a study: its passed checks, or the reason why it could not be run."""

    name: str
    passed: int
    checks: int
    error: str = ''

    @property
    def code(self) -> int:
        """0 if every check passed, 1 if not, 2 if there is no verdict."""
        return 2 if self.error else int(self.passed < self.checks)


def _run(name: str, options: argparse.Namespace, console: Console) -> Outcome:
    """Run one study and report it."""
    start = time.monotonic()
    try:
        folder = ready(options.out / name)
        with Progress(*_COLUMNS, console=console, transient=True) as bar:
            bar.add_task('running the nodes')
            study_run.taken()  # drop the runs of a study that failed
            findings = import_module(f'{__package__}.{name}').study(options.size)
        ran = study_run.described(study_run.taken())
        _report(console, folder, findings, time.monotonic() - start, ran)
    except (ValueError, NodeError, RuntimeError) as error:
        print(f'study: {name}: {error}', file=sys.stderr)
        return Outcome(name, 0, 0, str(error))
    counted = [check for check in findings.checks if check.counts]
    return Outcome(name, sum(check.passed for check in counted), len(counted))


def _conclude(outcomes: Sequence[Outcome], console: Console) -> None:
    """Print the outcome of every study, and exit with the worst code."""
    from kalman_ros.report.run_tables import plain_table

    table = plain_table('', ('verdict', 'checks'))
    for outcome in outcomes:
        verdict = ('[green]PASS[/]', '[bold red]FAIL[/]', '[bold red]no verdict[/]')[outcome.code]
        table.add_row(outcome.name, verdict, f'{outcome.passed} of {outcome.checks}')
    console.print()
    console.print(table)
    good = sum(outcome.code == 0 for outcome in outcomes)
    word = '[green]PASS' if good == len(outcomes) else '[bold red]FAIL'
    console.print(f'{word}, {good} of {len(outcomes)} studies[/]')
    sys.exit(max(outcome.code for outcome in outcomes))


def _report(console: Console, folder: Path, findings: Findings, wall: float, ran: str) -> None:
    """Print and write the findings of a study."""
    from kalman_ros.report import run_tables, style  # loads while nothing waits

    console.print(run_tables.checks_table('', findings.checks))
    summary = {
        'study': folder.name,
        'wall': wall,
        'passed': all(check.passed for check in findings.checks),
        'checks': run_tables.checks_json(findings.checks),
        **findings.data,
    }
    # the summary last: if it exists, the results are complete
    with deferred():
        title = ': '.join(filter(None, (f'study {folder.name}', ran)))
        with style.caption(f'{title}\n{claim(folder.name)}'):
            findings.draw(folder / f'{folder.name}.png')
        (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    console.print(f'{wall:.1f} s; in {folder}: summary.json, {folder.name}.png', style='dim')
