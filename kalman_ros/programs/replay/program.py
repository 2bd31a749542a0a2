# SPDX-License-Identifier: Apache-2.0
"""Replay a recording through the estimator, and judge the filter by its innovations."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from math import inf
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from kalman_ros import models
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.replay import estimator_settings, replay_bag
from kalman_ros.bags.replayed import Replayed
from kalman_ros.harness.interrupts import deferred
from kalman_ros.programs.common_arguments import Once, add_parameters, add_part
from kalman_ros.programs.refusal import interruptible, refuse
from kalman_ros.programs.results import of_recording, ready
from kalman_ros.scenario.parameter_files import overrides

from . import comparison, statistics, tables


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='replay',
        description='Pass a recording through the estimator as its node would have received it, '
        'faster than real time, and check whether the filter is consistent.',
        epilog='Exit code: 0 if every check passes, 1 if not, 2 if it could not be replayed.',
    )
    parser.add_argument(
        'bag', metavar='BAG', help='a folder of rosbag2, one of its files, or a bag of ROS 1'
    )
    parser.add_argument(
        '--params-file', metavar='FILE', action=Once,
        help=f'a parameter file, or the name of one in config/ (default: {models.DEFAULT})',
    )  # fmt: skip
    add_parameters(parser, 'a parameter over those of the file, such as imu.topic:=/imu/data')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='for the results (default: out/BAG/replay)'
    )
    parser.add_argument('--smooth', action='store_true', help='smooth the states, too')
    add_part(parser)
    parser.add_argument(
        '--truth', default='', metavar='TOPIC',
        help='true states, as the estimate has them, or true poses',
    )  # fmt: skip
    parser.add_argument(
        '--against', default='', metavar='TOPIC',
        help='poses of another estimator: an odometry, or a pose',
    )  # fmt: skip
    parser.add_argument(
        '--namespace', default='/', metavar='NAME', help='of the topics in the parameter file'
    )
    return parser.parse_args(argv)


def replayed_with_progress(
    options: argparse.Namespace, folder: Path, console: Console
) -> tuple[Replayed, float]:
    """Return the replay, and the seconds that it took."""
    settings = estimator_settings(options.params_file, overrides(options.parameters))
    bag = Bag(options.bag)
    ready(folder)
    whole = (bag.end - bag.start) * 1e-9
    bar = Progress(
        TextColumn('{task.description}'),
        BarColumn(),
        TextColumn('{task.completed:.0f} of {task.total:.0f} s'),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    )
    with bar:
        task = bar.add_task('replaying', total=max(0.0, min(options.end, whole) - options.start))
        begun = time.monotonic()
        replayed = replay_bag(
            bag,
            settings,
            start=options.start,
            end=options.end,
            smooth=options.smooth,
            truth=options.truth,
            against=options.against,
            namespace=options.namespace,
            out=folder / 'estimate',
            progress=lambda done: bar.update(task, completed=done),
        )
        return replayed, time.monotonic() - begun


@interruptible('replay')
def main(argv: Sequence[str] | None = None) -> None:
    """Replay a recording; exit with 0 if at least one check is made and all checks pass."""
    options = arguments(argv)
    console = Console(highlight=False)
    folder = options.out or of_recording(Path(options.bag), 'replay')
    try:
        run, wall = replayed_with_progress(options, folder, console)
    except (ValueError, OSError, ArithmeticError) as error:
        refuse('replay', error)
    errors = statistics.errors(run)
    checks = statistics.checks(run, errors)
    passed = bool(checks) and all(check.passed for check in checks)

    from kalman_ros.report import sheet, style
    from kalman_ros.report.run_tables import checks_table, verdict

    from . import pictures  # matplotlib is slow to load

    mode = 'lockstep' if run.lockstep else 'real time'
    title = f'{Path(options.bag).name}, {mode}: gaps in s, delays in ms'
    sheet.show(console, [(title, tables.sensor_sheet(run))])
    beside = comparison.comparison(run, options.against)
    if beside is not None:
        sheet.show(console, [comparison.sheet(beside)])
    console.print()
    for sentence in tables.sentences(run, errors):
        console.print(sentence, markup=False)
    if beside is not None:
        for sentence in comparison.sentences(run, beside):
            console.print(sentence, markup=False)
    if checks:
        console.print(checks_table('Consistency', checks))
    ratio = run.duration / wall if wall > 0.0 else inf
    console.print(
        f'{run.duration:.4g} s, {len(run.beliefs.time)} estimates, replayed in {wall:.2f} s, '
        f'{ratio:.3g} times real time; arithmetic: {run.arithmetic}'
    )
    # the summary last: if it exists, the results are complete
    with deferred():
        with style.caption(
            f'replay of {Path(options.bag).name}, filter {run.scenario.filter}, {mode}'
        ):
            drawn = pictures.draw_all(run, folder)
            if beside is not None and beside.apart is not None:
                drawn.append(folder / 'against.png')
                pictures.against(run, beside, drawn[-1])
        if run.smoothed is not None:
            s = run.smoothed
            np.savez(folder / 'smoothed.npz', time=s.time, mean=s.mean, covariance=s.covariance)
            drawn.append(folder / 'smoothed.npz')
        summary = tables.summary(run, errors, checks, passed)
        if beside is not None:
            summary['against'] = comparison.summary(beside)
        (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    files = ', '.join(['summary.json', 'estimate', *(path.name for path in drawn)])
    console.print(f'In {folder}: {files}')
    if checks:
        console.print(verdict(checks, tables.claim(run)))
    else:
        why = 'fewer than 20 innovations of any sensor'
        console.print(f'[bold red]FAIL, 0 of 0 checks hold:[/] {why}')
    sys.exit(0 if passed else 1)
