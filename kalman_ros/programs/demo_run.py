# SPDX-License-Identifier: Apache-2.0
"""The runs of a demo: the nodes are started, advanced, recorded and judged."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, inf, nan
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.cross_track import cross_track
from kalman_ros.analysis.verdict import Judgement, judge, least_duration
from kalman_ros.core import Array, in_continuous_time
from kalman_ros.harness import Run
from kalman_ros.harness.followed_path import publish_path
from kalman_ros.simulation.trajectory import Trajectory

from .results import RECORDED, ready
from .tunings import Tuning, tunings

#: The default duration in seconds.
DURATION = 60.0


@dataclass(frozen=True)
class Performed:
    """A run, its record and its judgement."""

    tuning: Tuning
    run: Run
    trajectory: Trajectory
    wall: float
    missed: int
    judgement: Judgement
    #: How far the motion along a path has got where the run ends before it; '' elsewhere.
    unfinished: str = ''

    @property
    def failed(self) -> list[str]:
        """Names of the failed checks."""
        return [c.name for c in self.judgement.checks if c.counts and not c.passed]


def perform(options: argparse.Namespace, console: Console) -> list[Performed]:
    """Run the nodes, once or for two tunings, and judge each run."""
    name = Path(options.scenario).stem
    asked = tunings(options, options.out or Path('out') / name)
    runs = [
        Run(
            tuning.scenario,
            tuning.parameters,
            seed=options.seed,
            lockstep=not options.realtime,
            recording=_recording(options, tuning),
        )
        for tuning in asked
    ]
    for run in runs:
        in_continuous_time(run.scenario.model)  # the theory requires it
    _check_comparable(runs)
    least = max(least_duration(run.scenario) for run in runs)
    if options.duration is None:
        options.duration = max(asked[0].own.duration or DURATION, float(ceil(least)))
    if not least <= options.duration < inf:
        unit, got = asked[0].own.time_unit, f'got {options.duration:g}'
        raise ValueError(f'duration: expected {least:.4g} {unit} or more for a verdict, {got}')
    for tuning in asked:
        ready(tuning.folder)
    return [_run_and_judge(tuning, run, options, console) for tuning, run in zip(asked, runs)]


def _recording(options: argparse.Namespace, tuning: Tuning) -> Path | str | None:
    """Return the folder of the recording of a run; None if it is not recorded."""
    if not options.record:
        return None if options.record is None else tuning.folder / RECORDED
    return Path(options.record, 'against') if tuning.folder.name == 'against' else options.record


def _check_comparable(runs: Sequence[Run]) -> None:
    """Raise ValueError if the states or the inputs of two runs differ."""
    first, *others = (run.scenario.model for run in runs)
    for other in others:
        for space in ('state', 'input'):
            one, two = getattr(first, space), getattr(other, space)
            if one.names != two.names:
                raise ValueError(f'--against: expected the same {space}, ({one}), got ({two})')


def _run_and_judge(
    tuning: Tuning, run: Run, options: argparse.Namespace, console: Console
) -> Performed:
    bar = Progress(
        TextColumn('{task.description}'),
        BarColumn(),
        TextColumn(f'{{task.completed:.0f}} of {{task.total:.0f}} {unit_of(tuning)}'),
        TimeRemainingColumn(),
        console=console,
    )
    with bar:
        task = bar.add_task(f'starting {len(run.names)} nodes', total=options.duration)
        with run:
            bar.update(task, description=f'ROS_DOMAIN_ID={run.domain}')
            if tuning.own.path is not None:
                publish_path(run, tuning.own.path)
                _check_planned(run)
            start = time.monotonic()
            run.advance(options.duration, lambda done: bar.update(task, completed=done))
            wall = time.monotonic() - start
            run.complete()
            bar.update(task, completed=options.duration, description='recorded')
            trajectory = run.trajectory()
            unfinished = ''
            if tuning.own.path is not None:
                _check_planned(run)
                unfinished = run.reported('controller', 'motion')
            missed = int(run.reported('plant', 'missed steps'))
    judgement = judge(run.scenario, trajectory)
    if tuning.own.path is not None:
        checks = [*judgement.checks, *_distances(run, trajectory, tuning.own.path)]
        judgement = replace(judgement, checks=checks)
    return Performed(tuning, run, trajectory, wall, missed, judgement, unfinished)


def _check_planned(run: Run) -> None:
    """Raise ValueError if the controller has refused the path, so that nothing moves."""
    run.refresh('controller')
    reason = run.reported('controller', 'reason of the last refusal')
    if reason:
        raise ValueError(reason)


def _distances(run: Run, trajectory: Trajectory, path: Array) -> list[Check]:
    """Return how far the true position was from a path, and from its end; they are not judged."""
    places = run.scenario.model.state.indices(('x', 'y'))
    true = trajectory.truth[:, list(places)]
    from_path = cross_track(path, true)
    rows = {
        'distance from the path, RMS': float(np.sqrt(np.nanmean(from_path**2))),
        'distance from the path, largest': float(np.nanmax(from_path)),
        'distance from its end': float(np.linalg.norm(true[-1] - path[-1])),
    }
    return [Check(name, 'm', nan, value, nan, nan, passed=True) for name, value in rows.items()]


def unit_of(tuning: Tuning) -> str:
    """Return the unit of time of a scenario in words."""
    unit = tuning.own.time_unit
    return 'simulated seconds' if unit == 's' else unit
