# SPDX-License-Identifier: Apache-2.0
"""Results of a replay, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from kalman_ros.analysis.pose_paths import PosePath, path_of_states
from kalman_ros.analysis.records import Beliefs, InputRecord, SensorRecord
from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.scenario import Scenario


@dataclass(frozen=True)
class SensorReplay(SensorRecord):
    """Outcomes of a sensor's N readings, and the counts of the whole replay.

    Times are in seconds from the start of the recording; a reading is NaN where the message lacked
    fields. An outcome is the one at the time of reception.

    Parameters
    ----------
    counts
        Number of readings by outcome, at the end: a late reading may have changed the outcome of
        another one.
    undecodable
        Number of messages that were not of the type, or too long.
    """

    counts: Mapping[Outcome, int]
    undecodable: int

    @property
    def fused(self) -> int:
        """Number of readings that moved the estimate."""
        return sum(count for outcome, count in self.counts.items() if outcome.accepted)


@dataclass(frozen=True)
class Truth:
    """True states (N, n) at times (N,), in seconds from the start."""

    time: Array
    state: Array

    def at(self, scenario: Scenario, time: Array) -> Array:
        """Return the states (M, n) at times (M,), interpolated between the known states.

        Outside of the known times they are NaN.
        """
        space = scenario.model.state
        if len(self.time) < 2:
            return np.full((len(time), space.size), np.nan)
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        before = after - 1
        length = self.time[after] - self.time[before]
        share = (time - self.time[before]) / np.where(length > 0.0, length, 1.0)
        change = space.subtract(self.state[after], self.state[before])
        state = space.add(self.state[before], share[:, np.newaxis] * change)
        inside = (time >= self.time[0]) & (time <= self.time[-1])
        return np.where(inside[:, np.newaxis], state, np.nan)


@dataclass(frozen=True, repr=False)
class Replayed:
    """A recording as the estimator processed it.

    Parameters
    ----------
    scenario
        Model and sensors.
    start
        Time in nanoseconds from which all others are counted: the reception of the first message
        of the recording, or in lockstep the stamp of the first step.
    duration
        Seconds from the first to the last message that was used; in lockstep, simulated seconds.
    lockstep
        Whether the recording is of a run in lockstep.
    sensors
        Enabled sensors by name.
    beliefs
        Beliefs after each reading that corrected the estimate, or after each step.
    inputs
        Inputs as they were received.
    restarts, repairs
        Numbers of restarts and repairs of the estimator.
    smoothed
        Beliefs given all readings, if requested.
    biases
        Biases of the sensors that have one, at the end.
    truth
        True states, if the recording has them and their topic was named.
    notes
        Sentences about what is missing or damaged.
    arithmetic
        Arithmetic of the model and the sensors: C, CasADi or numpy, with the reason.
    true_poses
        True poses, if their topic was named as that of the truth.
    against
        Poses of another estimator, if their topic was named.
    frame
        Frame of the estimates.
    """

    scenario: Scenario
    start: int
    duration: float
    lockstep: bool
    sensors: Mapping[str, SensorReplay]
    beliefs: Beliefs
    inputs: InputRecord
    restarts: int
    repairs: int
    smoothed: Beliefs | None
    biases: Mapping[str, Gaussian]
    truth: Truth | None
    notes: tuple[str, ...]
    arithmetic: str = 'numpy'
    true_poses: PosePath | None = None
    against: PosePath | None = None
    frame: str = ''

    def poses(self) -> PosePath | None:
        """Return the poses of the estimates; None if the state has none."""
        return self._path(self.beliefs.time, self.beliefs.mean, self.beliefs.covariance)

    def reference(self) -> PosePath | None:
        """Return the true poses, if they are known."""
        if self.true_poses is not None or self.truth is None:
            return self.true_poses
        return self._path(self.truth.time, self.truth.state, None)

    def _path(self, time: Array, mean: Array, covariance: Array | None) -> PosePath | None:
        scenario = self.scenario
        return path_of_states(
            scenario.model.state, scenario.state, time, mean, covariance, self.frame
        )

    def __repr__(self) -> str:
        rows = (f'{name}: {s.fused} of {len(s.nis)} fused' for name, s in self.sensors.items())
        sensors = ', '.join(rows)
        return f'Replayed({self.duration:.4g} s, {len(self.beliefs.time)} beliefs, {sensors})'
