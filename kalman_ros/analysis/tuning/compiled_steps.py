# SPDX-License-Identifier: Apache-2.0
"""The steps of a walk through plain readings, each candidate's filter by one call into C."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, unchecked
from kalman_ros.core.ordered_data import OrderedData
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.plan import all_parts

from .block import Block
from .candidate import Candidate
from .observations import Observations


class CompiledSteps:
    """The extended filters of p candidates without gates and delays, in C.

    Parameters
    ----------
    observations
        Recording.
    candidates
        Candidates.
    """

    def __init__(self, observations: Observations, candidates: Sequence[Candidate]) -> None:
        self._observations, self._candidates = observations, candidates
        self._names = list(observations.readings)

    @staticmethod
    def suit(candidates: Sequence[Candidate]) -> bool:
        """Return whether the filters are of the kind that has these steps."""
        return all(
            type(candidate.filter) is ExtendedKalmanFilter
            and getattr(candidate.model, 'arithmetic', '') == 'C'
            for candidate in candidates
        )

    def __call__(
        self, belief: Gaussian, now: int, events: Any, u: Array
    ) -> tuple[Gaussian, list[Block]] | None:
        """Return the beliefs (p, n) after events, and the innovations of each sensor.

        None where a reading lacks a number, or a step fails.

        Parameters
        ----------
        belief, now
            Beliefs, and their time in nanoseconds.
        events
            Time, order and row (S, 3), as of `Event`.
        u
            Input that acts until the first one among the events.
        """
        time, order, row = events.T
        rows = [row[order == index] for index in range(len(self._names))]
        every = [*self._observations.readings.values()]
        if any(not np.isfinite(record.value[at]).all() for record, at in zip(every, rows)):
            return None
        sensor = np.where(order == len(rows), -1, order)
        begun = np.cumsum(sensor < 0)
        dt = np.diff(np.maximum.accumulate(np.concatenate(([now], time)))) * 1e-9
        inputs = np.vstack((u, self._observations.input[row[sensor < 0]]))
        means, covariances, readings = [], [], []
        for p, candidate in enumerate(self._candidates):
            data = OrderedData(
                time * 1e-9, dt, inputs, begun - (sensor < 0), sensor, row,
                *zip(*map(self._readings, [candidate] * len(rows), self._names, rows)),
            )  # fmt: skip
            steps = candidate.model.filter_pass(
                (belief.mean[p], belief.covariance[p]),
                data,
                all_parts(candidate.model, dt),
                [candidate.sensors[name] for name in self._names],
                [np.inf] * len(rows),
                kept=False,
            )
            if steps is None:
                return None
            means.append(steps.after[0])
            covariances.append(steps.after[1])
            readings.append(steps.readings)
        sensors = self._candidates[0].sensors
        blocks = [
            Block(
                name,
                sensors[name].output,
                time[order == index],
                np.stack([matrices[index].innovation for matrices in readings], axis=1),
                np.stack([matrices[index].S for matrices in readings], axis=1),
                np.ones((len(rows[index]), len(readings)), dtype=bool),
            )
            for index, name in enumerate(self._names)
            if len(rows[index])
        ]
        return unchecked((np.stack(means), np.stack(covariances))), blocks

    def _readings(self, candidate: Candidate, name: str, rows: Any) -> tuple[Array, Array]:
        """Return the readings (N, k) of a sensor and their covariances (N, k, k)."""
        readings = self._observations.readings[name]
        y = readings.value[rows]
        R, carried = candidate.sensors[name].covariance, readings.covariance
        if carried is not None:
            R = carried[rows]
        return y - candidate.biases.get(name, 0.0), np.broadcast_to(R, (*y.shape, y.shape[1]))
