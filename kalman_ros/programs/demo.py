# SPDX-License-Identifier: Apache-2.0
"""Run the loop, and compare the measurements with theory."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)  # fmt: skip

from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.suspects import suspects
from kalman_ros.harness import NodeError
from kalman_ros.harness.interrupts import deferred
from kalman_ros.programs.common_arguments import add_parameters, add_scenario
from kalman_ros.programs.refusal import refuse
from kalman_ros.scenario.drawing import drawing
from kalman_ros.simulation.trajectory import Trajectory

from .demo_run import DURATION, Performed, perform, unit_of


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='demo',
        description='Start plant, estimator, monitor and the other nodes of a scenario as '
        'processes, run them, and compare the measurements with theory.',
        epilog='Exit code: 0 if every check passes, 1 if not, 2 if there is no verdict, because '
        'it could not be run or its record is incomplete.',
    )
    add_scenario(parser)
    parser.add_argument(
        '--duration', type=float, metavar='S',
        help=f'simulated seconds (default: that of the scenario, or {DURATION:g})',
    )  # fmt: skip
    parser.add_argument('--realtime', action='store_true', help='in real time instead of lockstep')
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of all noise')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='for the results (default: out/SCENARIO)'
    )
    parser.add_argument(
        '--record', nargs='?', const='', metavar='DIR',
        help='record all topics of the loop (default: DIR is recording in the results)',
    )  # fmt: skip
    parser.add_argument(
        '--against', action='append', default=[], metavar='WHAT',
        help='a second run with the same seed, beside the first: NAME=VALUE, a filter or a '
        'parameter file; may be repeated',
    )  # fmt: skip
    parser.add_argument(
        '--animate', action='store_true',
        help='also an animation, animation.gif, and an MP4 where ffmpeg is installed',
    )  # fmt: skip
    add_parameters(parser, 'a parameter for every node, as with --ros-args')
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the demo; exit with 0 if every check passes, 1 if not, and 2 if it cannot run."""
    options = arguments(argv)
    console = Console()
    try:
        performed = perform(options, console)
    except (ValueError, NodeError, RuntimeError) as error:
        refuse('demo', error)

    from kalman_ros.report import run_tables  # loads while nothing waits

    mode = 'real time' if options.realtime else 'lockstep'
    title = f'{Path(options.scenario).stem}, {mode}, seed {options.seed}'
    if len(performed) == 1:
        checks = performed[0].judgement.checks
        console.print(run_tables.checks_table(f'{title}: theory and measurement', checks))
    else:
        labels = [f'{run}: {result.tuning.label}' for run, result in zip('AB', performed)]
        console.print(title, *labels, sep='\n', markup=False, highlight=False)
        console.print(run_tables.pair_table('', [_with_inputs(result) for result in performed]))
    names = ('',) if len(performed) == 1 else ('A: ', 'B: ')
    for run, result in zip(names, performed):
        console.print(run + _course(options, result))
        _write(options, result, mode, console)
    if len(performed) > 1:
        if any(check.name == 'cost J' for check in performed[0].judgement.checks):
            console.print('The cost J of each is by its own weights.')
        _write_pair(options, performed, mode, console)
    for run, result in zip(names, performed):
        judgement = result.judgement
        console.print(run + run_tables.verdict(judgement.checks, judgement.claim))
        for sentence in suspects(judgement.checks):
            console.print(sentence)
    sys.exit(1 if any(result.failed for result in performed) else 0)


def _with_inputs(performed: Performed) -> list[Check]:
    """Return the checks, followed by the RMS of each input."""
    space = performed.run.scenario.model.input
    rms = np.sqrt(np.mean(performed.trajectory.input**2, axis=0)).tolist()
    return [*performed.judgement.checks, *(
        Check(f'RMS of {name}', unit, nan, value, nan, nan, passed=True)
        for name, unit, value in zip(space.names, space.units, rms)
    )]  # fmt: skip


def _course(options: argparse.Namespace, performed: Performed) -> str:
    """Summarise a run in a sentence or two: duration, wall time, late steps and basis."""
    judgement = performed.judgement
    unit, settling = performed.tuning.own.time_unit, judgement.settling_time
    counted = f'; the first {settling:.1f} {unit} settle and do not count' if settling else ''
    late = f'{performed.missed} of {len(performed.trajectory.time)} steps late{counted}'
    on_path = performed.unfinished and f' It ends on the path, at {performed.unfinished}.'
    return (
        f'{options.duration:g} {unit_of(performed.tuning)} took {performed.wall:.1f} s, with '
        f'{late}. {judgement.basis}{on_path}'
    )


def _caption(options: argparse.Namespace, mode: str, performed: Performed, variant: str) -> Any:
    """Return the caption of pictures: scenario, ``variant``, mode, seed and duration."""
    from kalman_ros.report import style

    name, unit = Path(options.scenario).stem, performed.tuning.own.time_unit
    text = f'{name}, {variant}, {mode}, seed {options.seed}, {options.duration:g} {unit}'
    return style.caption(text, unit)


def _write(options: argparse.Namespace, performed: Performed, mode: str, console: Console) -> None:
    """Write data, pictures and the summary of a run."""
    from kalman_ros.report import run_pictures, run_tables

    tuning, built, run = performed.tuning, performed.run.scenario, performed.trajectory
    judgement, folder = performed.judgement, tuning.folder
    # the summary last: if it exists, the results are complete
    with deferred():
        _write_data(folder, run)
        with _caption(options, mode, performed, _variant(performed)):
            columns = (TextColumn('drawing {task.description}'), TimeElapsedColumn())
            with Progress(*columns, console=console, transient=True) as bar:
                task = bar.add_task('')
                drawn = run_pictures.draw_all(
                    built, run, folder, tuning.limits(built), tuning.own.path,
                    lambda name: bar.update(task, description=name),
                )  # fmt: skip
            if options.animate:
                drawn += _animation(options, performed, console)
        summary = {
            'scenario': Path(tuning.scenario).stem, 'mode': mode, 'seed': options.seed,
            'duration': options.duration, 'wall': performed.wall,
            'missed_steps': performed.missed, 'settling_time': judgement.settling_time,
            'passed': not performed.failed,
            'checks': run_tables.checks_json(judgement.checks),
        }  # fmt: skip
        (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    files = ', '.join(['summary.json', 'data.npz', *(path.name for path in drawn)])
    console.print(f'In {folder}: {files}')


def _variant(performed: Performed) -> str:
    """Return the filter of a run, and what its tuning changes."""
    return ', '.join(
        filter(None, (f'filter {performed.run.scenario.filter}', performed.tuning.label))
    )


def _animation(options: argparse.Namespace, performed: Performed, console: Console) -> list[Path]:
    """Draw the system in motion, and return the files."""
    from kalman_ros.report.animation import animate, shown_steps
    from kalman_ros.report.drawings import Moments

    tuning, built, run = performed.tuning, performed.run.scenario, performed.trajectory
    how = drawing(tuning.model, built.model.state)
    show = Moments(built, run, shown_steps(built, run), how.heading, tuning.length)
    bar = Progress(
        TextColumn('{task.description}'), BarColumn(), TimeRemainingColumn(), console=console
    )
    with bar:
        task = bar.add_task('animation', total=1.0)
        which = Path(tuning.scenario).stem, _variant(performed), f'seed {options.seed}'
        title = ', '.join(which)
        path = tuning.folder / 'animation.gif'
        try:
            return animate(
                how.kind, show, title, path, lambda done: bar.update(task, completed=done)
            )
        except RuntimeError as error:  # the GIF was written before
            console.print(f'[yellow]Warning:[/] {error}')
            return [path]


def _write_pair(
    options: argparse.Namespace, performed: Sequence[Performed], mode: str, console: Console
) -> None:
    """Draw two runs in one picture."""
    from kalman_ros.report.pair_pictures import pair

    path = performed[0].tuning.folder / 'against.png'
    labels = [result.tuning.label for result in performed]
    with _caption(options, mode, performed[0], ' against '.join(labels)):
        scenarios = [result.run.scenario for result in performed]
        pair(scenarios, [result.trajectory for result in performed], labels, path)
    console.print(f'Both: {path}')


def _write_data(folder: Path, run: Trajectory) -> None:
    columns: dict[str, Any] = {
        'time': run.time,
        'truth': run.truth,
        'estimate': run.estimate,
        'covariance': run.covariance,
        'input': run.input,
    }
    for name, series in run.readings.items():
        columns[f'{name}_time'], columns[name] = series.time, series.values
    for name, innovations in run.innovations.items():
        columns[f'{name}_innovation'] = innovations.values
        columns[f'{name}_nis'] = innovations.nis
    np.savez_compressed(folder / 'data.npz', **columns)
