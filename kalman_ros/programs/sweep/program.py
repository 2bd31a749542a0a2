# SPDX-License-Identifier: Apache-2.0
"""Maps of cost, errors, consistency and lost runs over one or two parameters of a loop."""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from kalman_ros import scenario
from kalman_ros.programs.common_arguments import add_parameters, add_scenario
from kalman_ros.programs.known_parameters import refuse_unknown_parameters
from kalman_ros.programs.refusal import refuse
from kalman_ros.programs.results import ready
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file, overrides
from kalman_ros.simulation.monte_carlo import spawned
from kalman_ros.simulation.spread import spread

from .grid import Grid, Point
from .ranges import parsed

#: Reason for missing points, if a person interrupted the sweep.
INTERRUPTED = 'interrupted'


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='sweep',
        description='Run a loop many times at each value of one or two parameters, without '
        'nodes, and put cost, errors, consistency and lost runs side by side.',
        epilog='Exit code: 0 if all points are there, 1 if workers ended before, 2 for a bad '
        'argument, 130 if it is interrupted: points that are finished are kept.',
    )
    add_scenario(parser)
    parser.add_argument(
        '--over', action='append', required=True, metavar='NAME=LOW..HIGH:log:COUNT',
        help='a parameter and its values, log or lin; once or twice. plant.NAME is that of the '
        'plant alone, estimator.NAME of estimator and controller alone; NAME[0] is one of several',
    )  # fmt: skip
    parser.add_argument(
        '--runs', type=int, default=100, metavar='N', help='at each point (default: %(default)d)'
    )
    parser.add_argument(
        '--seconds', type=float, default=10.0, metavar='S', help='of a run (default: %(default)g)'
    )
    parser.add_argument(
        '--after', type=float, metavar='S',
        help='seconds of the start that averages omit (default: what theory needs to settle)',
    )  # fmt: skip
    parser.add_argument('--seed', type=int, default=0, metavar='N')
    parser.add_argument(
        '--workers', type=int, default=1, metavar='N', help='processes (default: %(default)d)'
    )
    parser.add_argument(
        '--dask', default='', metavar='ADDRESS',
        help='a Dask scheduler, tcp://HOST:8786, whose workers run the points instead',
    )  # fmt: skip
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='for the results (default: out/SCENARIO/sweep)'
    )
    add_parameters(parser, 'a parameter, over those of the file')
    return parser.parse_args(argv)


def grid_of(options: argparse.Namespace, path: Path) -> Grid:
    """Return the grid of the options, after a check of each of its points.

    Raises
    ------
    ValueError
        If an option is wrong.
    """
    for name, least in (('runs', 1), ('workers', 1), ('seed', 0)):
        if getattr(options, name) < least:
            raise ValueError(f'{name}: expected at least {least}, got {getattr(options, name)}')
    if not (isfinite(options.seconds) and options.seconds > 0.0):
        raise ValueError(f'seconds: expected a positive number, got {options.seconds:g}')
    if options.after is not None and not 0.0 <= options.after < options.seconds:
        raise ValueError(f'after: expected 0 to {options.seconds:g} s, got {options.after:g}')
    if len(options.over) > 2:
        raise ValueError(f'over: expected one or two parameters, got {len(options.over)}')
    ranges = [parsed(text) for text in options.over]
    if len({(item.name, item.index) for item in ranges}) < len(ranges):
        raise ValueError(f'over: expected two parameters, got {options.over[0]} twice')
    changes = overrides(options.parameters)
    plant = {**from_file(path, 'plant'), **changes}
    believed = {**from_file(path, 'estimator', 'controller'), **changes}
    refuse_unknown_parameters(believed)
    seeds = spawned(options.seed, options.runs)
    grid = Grid(plant, believed, ranges, seeds, options.seconds, options.after)
    for values in grid.points:
        grid.loop(values)
    return grid


def swept(grid: Grid, workers: int, dask: str, console: Console) -> tuple[dict[int, Point], str]:
    """Return the outcomes at the finished points, and the reason why other points are missing.

    Raises
    ------
    ValueError, KeyboardInterrupt
        If no point is finished.
    """
    outcomes: dict[int, Point] = {}
    columns = (TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn())
    try:
        with Progress(*columns, TimeRemainingColumn(), console=console) as bar:
            task = bar.add_task('points', total=len(grid.points))
            for index, point in spread(grid, grid.points, workers, dask):
                outcomes[index] = point
                bar.advance(task)
    except (ValueError, KeyboardInterrupt) as error:
        if not outcomes:
            raise
        return outcomes, str(error) or INTERRUPTED
    return outcomes, ''


def main(argv: Sequence[str] | None = None) -> None:
    """Run the sweep, print its table and write its results."""
    options = arguments(argv)
    console = Console(highlight=False)
    try:
        path = shipped.file(options.scenario)
        grid = grid_of(options, path)
        folder = ready(options.out or Path('out') / path.stem / 'sweep')
        outcomes, stopped = swept(grid, options.workers, options.dask, console)
    except (ValueError, OSError) as error:
        refuse('sweep', error)

    from kalman_ros.report import style

    from . import pictures, tables  # matplotlib loads while nothing waits

    points = [outcomes[index] for index in sorted(outcomes)]
    state = scenario.build(grid.believed).model.state
    for table in tables.sweep_tables(grid.ranges, state, points):
        console.print(table)
    _explain(console, points, grid)
    summary = {
        'scenario': path.stem,
        'runs': options.runs,
        'seconds': options.seconds,
        'seed': options.seed,
        'stopped': stopped,
        'missing': len(grid.points) - len(points),
        'points': [point.json(grid.ranges, state.names) for point in points],
    }
    (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    drawn = ''
    if any(point.rms for point in points):
        # a map has a cell for each point, finished or not
        all_points = [outcomes.get(k, Point(values)) for k, values in enumerate(grid.points)]
        marks = [swept.configured(grid.plant) for swept in grid.ranges]
        about = f'sweep of {path.stem}: {options.runs} runs at each point, seed {options.seed}'
        with style.caption(about):
            pictures.sweep_picture(grid.ranges, state, all_points, marks, folder / 'sweep.png')
        drawn = ', sweep.png'
    console.print(f'In {folder}: summary.json{drawn}')
    if stopped:
        count = f'{len(points)} of {len(grid.points)} points'
        console.print(f'FAIL, {count}: {stopped}', style='bold red', markup=False)
        sys.exit(128 + signal.SIGINT if stopped == INTERRUPTED else 1)


def _explain(console: Console, points: Sequence[Point], grid: Grid) -> None:
    """Print the meaning of the columns, and of the points that are unusual."""
    console.print(
        f'\n{len(grid.seeds)} runs of {grid.seconds:g} s at each point, with the same noise at '
        'all. Under the names of states: RMS errors of the estimate. Lost runs are in no average.'
    )
    if any(not (point.refused or point.consistent) for point in points):
        console.print(
            '* outside of the range of 19 in 20 consistent filters. All points have the same '
            'noise, so that by chance many are so at once: with another --seed they are not, '
            'unless the covariance is wrong.'
        )
    for reason in dict.fromkeys(point.refused for point in points if point.refused):
        console.print(f'no design: {reason}', markup=False)
