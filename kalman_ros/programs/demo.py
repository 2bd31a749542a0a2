# SPDX-License-Identifier: Apache-2.0
"""Runs the loop, and compares the measurements with theory."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from math import ceil, inf
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from kalman_ros.analysis.suspects import suspects
from kalman_ros.analysis.verdict import judge, least_duration
from kalman_ros.control.limiter import Limits
from kalman_ros.harness import NodeError, Run
from kalman_ros.harness.interrupts import deferred
from kalman_ros.programs.common_arguments import add_parameters, add_scenario
from kalman_ros.programs.refusal import refuse
from kalman_ros.scenario import regulator, shipped
from kalman_ros.scenario.demo_section import Demo, demo_section
from kalman_ros.scenario.parameter_files import from_file, overrides
from kalman_ros.simulation.trajectory import Trajectory

from .results import ready

#: The default duration in seconds.
_DURATION = 60.0


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
        help=f'simulated seconds (default: that of the scenario, or {_DURATION:g})',
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
    add_parameters(parser, 'a parameter for every node, as with --ros-args')
    return parser.parse_args(argv)


def perform(
    options: argparse.Namespace, own: Demo, folder: Path, console: Console
) -> tuple[Run, Trajectory, float, int]:
    """Run the nodes; return the run, its trajectory, its wall time and the missed steps."""
    run = Run(
        options.scenario,
        {**own.parameters, **overrides(options.parameters)},
        seed=options.seed,
        lockstep=not options.realtime,
        recording=folder / 'recording' if options.record == '' else options.record,
    )
    least = least_duration(run.scenario)
    if options.duration is None:
        options.duration = max(own.duration or _DURATION, float(ceil(least)))
    if not least <= options.duration < inf:
        raise ValueError(f'duration: expected {least:.4g} s or more, got {options.duration:g}')
    ready(folder)
    bar = Progress(
        TextColumn('{task.description}'),
        BarColumn(),
        TextColumn('{task.completed:.0f} of {task.total:.0f} simulated seconds'),
        TimeRemainingColumn(),
        console=console,
    )
    with bar:
        task = bar.add_task(f'starting {len(run.names)} nodes', total=options.duration)
        with run:
            bar.update(task, description=f'ROS_DOMAIN_ID={run.domain}')
            start = time.monotonic()
            run.advance(options.duration, lambda done: bar.update(task, completed=done))
            wall = time.monotonic() - start
            run.complete()
            bar.update(task, completed=options.duration, description='recorded')
            trajectory = run.trajectory()
            missed = int(run.reported('plant', 'missed steps'))
    return run, trajectory, wall, missed


def limits(options: argparse.Namespace, own: Demo, run: Run) -> Limits:
    """Return the limits of the actuators, which are parameters of the controller."""
    values = {
        **from_file(shipped.file(options.scenario), 'controller'),
        **own.parameters,
        **overrides(options.parameters),
    }
    names = ('input_limit', 'input_rate_limit')
    return regulator.limits(run.scenario, *(values.get(name, inf) for name in names))


def main(argv: Sequence[str] | None = None) -> None:
    """Run the demo; the exit code says whether theory and measurement agree."""
    options = arguments(argv)
    console = Console()
    name = Path(options.scenario).stem
    folder = options.out or Path('out') / name
    try:
        own = demo_section(shipped.file(options.scenario))
        run, trajectory, wall, missed = perform(options, own, folder, console)
        judgement = judge(run.scenario, trajectory)
    except (ValueError, NodeError, RuntimeError) as error:
        refuse('demo', error)
    checks = judgement.checks
    failed = [check.name for check in checks if check.counts and not check.passed]

    from kalman_ros.report import run_pictures, run_tables, style  # loads while nothing waits

    mode = 'real time' if options.realtime else 'lockstep'
    title = f'{name}, {mode}, seed {options.seed}: theory and measurement'
    console.print(run_tables.checks_table(title, checks))
    console.print(
        f'{options.duration:g} simulated seconds took {wall:.1f} s, with {missed} of '
        f'{len(trajectory.time)} steps late; the first {judgement.settling_time:.1f} s settle '
        f'and do not count. {judgement.basis}'
    )
    # the summary last: if it exists, the results are complete
    with deferred():
        _write(folder, trajectory)
        about = f'{name}, filter {run.scenario.filter}, {mode}, seed {options.seed}'
        with style.caption(f'{about}, {options.duration:g} {own.time_unit}', own.time_unit):
            drawn = run_pictures.draw_all(
                run.scenario, trajectory, folder, limits(options, own, run)
            )
        summary = {
            'scenario': name, 'mode': mode, 'seed': options.seed, 'duration': options.duration,
            'wall': wall, 'missed_steps': missed, 'settling_time': judgement.settling_time,
            'passed': not failed,
            'checks': run_tables.checks_json(checks),
        }  # fmt: skip
        (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    files = ', '.join(['summary.json', 'data.npz', *(path.name for path in drawn)])
    console.print(f'In {folder}: {files}')
    console.print(run_tables.verdict(checks, judgement.claim))
    for sentence in suspects(checks):
        console.print(sentence)
    sys.exit(1 if failed else 0)


def _write(folder: Path, run: Trajectory) -> None:
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
