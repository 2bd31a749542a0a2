# SPDX-License-Identifier: Apache-2.0
"""The trajectories of many runs at once, for results that need every step of each run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators.batch_estimator import BatchEstimator
from kalman_ros.estimators.filter import Correction
from kalman_ros.simulation.batch_loop import Loop, Starts, run_batch
from kalman_ros.simulation.trajectory import Innovations, Series, Trajectory

#: Largest size of one array that is kept at a time.
_MOST = 20_000_000


def trajectories(
    loop: Loop, seeds: Sequence[int], starts: Starts | None = None
) -> list[Trajectory]:
    """Return the run of a loop with each seed, as `closed_loop.run` does.

    Raises
    ------
    ValueError
        If the filter has no batched form.
    """
    size = max(1, _MOST // (loop.steps * loop.scenario.model.state.size**2))
    result: list[Trajectory] = []
    for first in range(0, len(seeds), size):
        part = slice(first, first + size)
        recorder = Recorder(loop, len(seeds[part]))
        run_batch(loop, seeds[part], recorder, None if starts is None else starts.part(part))
        result += recorder.trajectories()
    return result


class Recorder:
    """Recorder of all steps of a batch.

    Parameters
    ----------
    loop
        Loops that are observed.
    runs
        Number of runs.
    """

    def __init__(self, loop: Loop, runs: int) -> None:
        model, steps = loop.scenario.model, loop.steps
        n, m = model.state.size, model.input.size
        self._names = list(loop.believed.sensors)
        self._dt, self._runs = 1.0 / loop.scenario.rate, runs
        self._truth, self._estimate = np.empty((steps, runs, n)), np.empty((steps, runs, n))
        self._covariance = np.empty((steps, runs, n, n))
        self._input = np.empty((steps, runs, m))
        self._read: dict[str, list[tuple[float, Array, Correction]]] = {
            name: [] for name in self._names
        }
        self._k = 0

    @property
    def _time(self) -> float:
        """Time of this step, rounded to nanoseconds as in a loop of one run."""
        return round(self._k * self._dt * 1e9) * 1e-9

    def reading(self, name: str, y: Array, correction: Correction) -> None:
        """Keep readings (runs, k) and their corrections."""
        self._read[name].append((self._time, y, correction))

    def step(self, estimator: BatchEstimator, truth: Array, u: Array) -> None:
        """Keep a step."""
        k = self._k
        self._truth[k], self._input[k] = truth, u
        self._estimate[k], self._covariance[k] = estimator.belief
        self._k += 1

    def trajectories(self) -> list[Trajectory]:
        """Return the run of each member."""
        time = np.array([round(k * self._dt * 1e9) * 1e-9 for k in range(self._k)])
        kept = {name: self._kept(name) for name in self._names}
        return [
            Trajectory(
                time,
                self._truth[:, run],
                self._estimate[:, run],
                self._covariance[:, run],
                self._input[:, run],
                readings={name: Series(t, y[:, run]) for name, (t, y, *_) in kept.items()},
                innovations={name: _innovations(run, *columns) for name, columns in kept.items()},
            )
            for run in range(self._runs)
        ]

    def _kept(self, name: str) -> tuple[Array, Array, Array, Array, Array]:
        """Return times (N,), and readings, innovations, deviations, NIS (N, runs, ...)."""
        rows = self._read[name]
        if not rows:
            nothing = np.empty((0, self._runs, 0))
            return np.empty(0), nothing, nothing, nothing, np.empty((0, self._runs))
        time, readings, corrections = zip(*rows)
        innovation = np.array([correction.innovation for correction in corrections])
        variance = [
            np.broadcast_to(
                correction.innovation_covariance.diagonal(axis1=-2, axis2=-1),
                correction.innovation.shape,
            )
            for correction in corrections
        ]
        nis = np.array([correction.nis for correction in corrections])
        return np.array(time), np.array(readings), innovation, np.sqrt(variance), nis


def _innovations(
    run: int, time: Array, readings: Array, innovation: Array, std: Array, nis: Array
) -> Innovations:
    finite = np.isfinite(nis[:, run])
    return Innovations(time[finite], innovation[finite, run], std[finite, run], nis[finite, run])
