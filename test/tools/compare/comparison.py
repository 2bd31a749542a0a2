# SPDX-License-Identifier: Apache-2.0
"""Filters on the same truths and readings: errors, consistency, lost tracks, time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Space
from kalman_ros.estimators import build_filter, filter_class
from kalman_ros.estimators.consistency import nees
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.batch_loop import Loop, Starts
from kalman_ros.simulation.noise import stream
from kalman_ros.simulation.trajectory import Trajectory

from .batch_recorder import trajectories
from .cases import Case

#: The time of a step is that of the fastest of N rounds of M steps each.
_ROUNDS, _STEPS = 7, 50
#: Runs between two reports of progress.
_TOGETHER = 100


@dataclass(frozen=True)
class Result:
    """The result of a case with one width and one filter.

    Parameters
    ----------
    time
        Of each step (N,), in seconds.
    errors
        Of each run at each step (runs, N).
    nees
        The NEES of each run, averaged over its steps and divided by its degrees (runs,).
    seconds_per_step
        Of a prediction and a correction together.
    """

    case: Case
    width: float
    filter: str
    time: Array
    errors: Array
    nees: Array
    seconds_per_step: float

    @property
    def final(self) -> Array:
        """The errors at the end (runs,)."""
        return np.asarray(self.errors[:, -1])

    @property
    def lost(self) -> int:
        """The number of runs that have lost track at the end."""
        return int(np.count_nonzero(~(self.final <= self.case.lost)))

    def summary(self) -> dict[str, Any]:
        """Return the summary of the runs."""
        return {
            'case': self.case.name,
            'uncertainty': self.case.widths[self.width],
            'filter': self.filter,
            'runs': len(self.final),
            'unit': self.case.unit,
            'median_error': float(np.median(self.final)),
            'percentile_95_error': float(np.quantile(self.final, 0.95)),
            'anees': float(np.mean(self.nees)),
            'median_nees': float(np.median(self.nees)),
            'lost': self.lost,
            'microseconds_per_step': 1e6 * self.seconds_per_step,
        }


def measured(
    case: Case, width: float, filter: str, runs: int, progress: Callable[[], None] = lambda: None
) -> Result:
    """Return the results of ``runs`` runs, with the seeds 0, 1, ...

    A seed gives every filter the same truth, initial belief and noise. ``progress`` is called
    after each run.
    """
    errors, consistency = [], []
    for first in range(0, runs, _TOGETHER):
        for run, space in _runs(case, width, filter, range(first, min(first + _TOGETHER, runs))):
            error = space.subtract(run.truth, run.estimate)
            errors.append(np.linalg.norm(error[:, space.indices(case.measured)], axis=1))
            consistency.append(nees(error, run.covariance).mean() / space.size)
            time = run.time
            progress()
    seconds = _seconds_per_step(case, width, filter)
    return Result(case, width, filter, time, np.array(errors), np.array(consistency), seconds)


def _runs(
    case: Case, width: float, filter: str, seeds: range
) -> Iterator[tuple[Trajectory, Space]]:
    """Yield the run of each seed, all at once if the filter can, with the space of its state."""
    starts = [case.start(width, stream(seed, 'start')) for seed in seeds]
    space = starts[0].model.state
    if filter_class(filter).mixture:
        for seed, built in zip(seeds, starts):
            run = closed_loop.run(
                built, None, case.seconds, seed, filter=filter, command=case.command,
                arrives=lambda _, time: _later(time),
            )  # fmt: skip
            yield run, space
        return
    truths = np.array([built.initial_state for built in starts])
    means, covariances = map(np.array, zip(*(built.initial_belief for built in starts)))
    loop = Loop(
        starts[0], starts[0], case.seconds, filter=filter, command=case.command, arrives=_later
    )
    together = Starts(truths, Gaussian(means, covariances))
    yield from ((run, space) for run in trajectories(loop, seeds, together))


def _later(time: float) -> bool:
    """Return whether readings count; the initial belief contains those of the start."""
    return time > 0.0


def _seconds_per_step(case: Case, width: float, filter: str) -> float:
    """Return the time of a prediction and a correction, from the initial belief."""
    built = case.start(width, stream(0, 'start'))
    estimator, belief = build_filter(filter, built.plan), built.initial_belief
    u, dt = built.model.equilibrium.input, built.plan.dt
    sensor = next(iter(built.enabled.values())).sensor
    y = sensor.measure(built.initial_state)
    rounds = []
    for _ in range(_ROUNDS):
        start = time.perf_counter()
        for _ in range(_STEPS):
            estimator.correct(estimator.predict(belief, u, dt), y, sensor)
        rounds.append((time.perf_counter() - start) / _STEPS)
    return min(rounds)
