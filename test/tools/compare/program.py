# SPDX-License-Identifier: Apache-2.0
"""Filters compared on nonlinear problems of increasing uncertainty."""

from __future__ import annotations

import argparse
import json
import platform
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from kalman_ros.core import refuse_unknown
from kalman_ros.estimators import FILTERS
from kalman_ros.programs.refusal import refuse
from kalman_ros.programs.results import ready

from .cases import CASES
from .comparison import Result, measured


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='compare',
        description='Run filters on the same truths and readings, and put their errors, their '
        'consistency, their lost tracks and their time side by side.',
    )
    parser.add_argument('cases', nargs='*', default=list(CASES), help=f'of {", ".join(CASES)}')
    parser.add_argument('--runs', type=int, default=500, help='of each (default: %(default)d)')
    parser.add_argument('--filters', nargs='+', default=['ekf', 'ukf'], metavar='FILTER')
    parser.add_argument(
        '--out', type=Path, default=Path('out/compare'), metavar='DIR',
        help='for the results (default: %(default)s)',
    )  # fmt: skip
    return parser.parse_args(argv)


def compare(options: argparse.Namespace, console: Console) -> list[Result]:
    """Return the result of every case, width and filter that the options ask for."""
    refuse_unknown(options.cases, CASES, 'case')
    refuse_unknown(options.filters, FILTERS, 'filter')
    if options.runs < 1:
        raise ValueError(f'runs: expected at least 1, got {options.runs}')
    ready(options.out)
    asked = [
        (CASES[name], width, filter)
        for name in options.cases
        for width in CASES[name].widths
        for filter in options.filters
    ]
    columns = (TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task('', total=len(asked) * options.runs)
        results = []
        for case, width, filter in asked:
            bar.update(task, description=f'{case.name}, {case.widths[width]}: {filter}')
            results.append(measured(case, width, filter, options.runs, lambda: bar.advance(task)))
    return results


def main(argv: Sequence[str] | None = None) -> None:
    """Run the comparison, print its table and write its results."""
    options = arguments(argv)
    console = Console()
    try:
        results = compare(options, console)
    except ValueError as error:
        refuse('compare', error)

    from . import pictures  # matplotlib loads while nothing waits

    console.print(pictures.comparison_table(results))
    machine = f'{platform.machine()}, Python {platform.python_version()}'
    console.print(f'{machine}, {options.runs} runs each, with the seeds 0, 1, ...')
    summary = {'machine': machine, 'results': [result.summary() for result in results]}
    (options.out / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    pictures.comparison_picture(results, options.out / 'errors.png')
    console.print(f'In {options.out}: summary.json, errors.png')
