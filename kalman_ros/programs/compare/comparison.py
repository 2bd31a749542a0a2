# SPDX-License-Identifier: Apache-2.0
"""Filters on the same truths and readings: errors, consistency, lost tracks, time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.consistency import nees
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.noise import stream

from .cases import Case

#: The time of a step is that of the fastest of N rounds of M steps each.
_ROUNDS, _STEPS = 7, 50


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
    for seed in range(runs):
        built = case.start(width, stream(seed, 'start'))
        run = closed_loop.run(
            built,
            None,
            case.seconds,
            seed,
            filter=filter,
            command=case.command,
            arrives=lambda _, time: time > 0.0,  # the initial belief contains earlier readings
        )
        space = built.model.state
        error = space.subtract(run.truth, run.estimate)
        errors.append(np.linalg.norm(error[:, space.indices(case.measured)], axis=1))
        consistency.append(nees(error, run.covariance).mean() / space.size)
        progress()
    seconds = _seconds_per_step(case, width, filter)
    return Result(case, width, filter, run.time, np.array(errors), np.array(consistency), seconds)


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
