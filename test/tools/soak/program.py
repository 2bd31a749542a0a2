# SPDX-License-Identifier: Apache-2.0
"""Runs the loop for long in real time, with faults, and checks its promises."""

from __future__ import annotations

import argparse
import json
import os
import platform
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from kalman_ros.harness import NodeError
from kalman_ros.programs.refusal import refuse
from kalman_ros.programs.results import ready

from .endurance import FAULTS, RATE, SCENARIO, Endurance
from .findings import Soak

#: Shorter runs cannot show a leak.
_LEAST = 0.3


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__)
    parser.add_argument(
        '--minutes', type=float, default=30.0, metavar='N', help='default: %(default)g'
    )
    parser.add_argument('--seed', type=int, default=1, help='of all noise (default: %(default)d)')
    parser.add_argument(
        '--out', type=Path, default=Path('out/soak'), metavar='DIR',
        help='for summary.json, data.npz, soak.md and soak.png (default: %(default)s)',
    )  # fmt: skip
    options = parser.parse_args(argv)
    if not options.minutes >= _LEAST:
        parser.error(f'argument --minutes: expected {_LEAST:g} or more, got {options.minutes:g}')
    return options


def soak(options: argparse.Namespace, console: Console) -> Soak:
    """Run the nodes for the requested duration, and return the findings."""
    ready(options.out)
    columns = TextColumn('{task.description}'), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(f'{RATE:g} Hz', total=60.0 * options.minutes)
        endurance = Endurance(options.seed)
        return endurance.soak(
            60.0 * options.minutes, lambda seconds: bar.update(task, completed=seconds)
        )


def main(argv: Sequence[str] | None = None) -> None:
    """Run, print the table, write the results; exit 1 if a promise is broken."""
    options = arguments(argv)
    console = Console()
    try:
        found = soak(options, console)
    except (ValueError, NodeError, RuntimeError, ProcessLookupError) as error:
        refuse('soak', error)
    _report(options, found, console)
    for what in found.broken:
        console.print(f'[bold red]broken:[/] {what}')
    if found.broken:
        console.print(found.verdict, style='bold red')
        sys.exit(1)
    console.print(found.verdict, style='green')


def _report(options: argparse.Namespace, found: Soak, console: Console) -> None:
    """Print and write what was found."""
    from .pictures import draw_soak, soak_page, soak_table

    console.print(soak_table(found))
    machine = f'{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}'
    faults = ', '.join(f'`{name}` {value:g}' for name, value in FAULTS.items())
    about = (
        f'`{SCENARIO}` at {RATE:g} Hz for {found.time[-1] / 60.0:.1f} minutes, seed '
        f'{options.seed}, with faults of both sensors: {faults}; and some of the actuator and '
        'the body.'
    )
    folder = options.out
    summary = {'machine': machine, 'seed': options.seed, **found.summary()}
    (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    columns: dict[str, Any] = {name: getattr(found, name) for name in _COLUMNS}
    np.savez_compressed(folder / 'data.npz', **{**columns, **found.resident})
    command = shlex.join(['./dev', 'soak', *sys.argv[1:]])
    (folder / 'soak.md').write_text(soak_page(found, command, machine, about, 'soak.png'))
    draw_soak(found, folder / 'soak.png')
    console.print(f'In {folder}: summary.json, data.npz, soak.md, soak.png', style='dim')


_COLUMNS = ('time', 'missed', 'withheld', 'median', 'tail')
