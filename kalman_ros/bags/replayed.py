# SPDX-License-Identifier: Apache-2.0
"""What comes of a replay, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from kalman_ros.analysis.records import Beliefs, InputRecord, SensorRecord
from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.scenario import Scenario


@dataclass(frozen=True)
class SensorReplay(SensorRecord):
    """What became of a sensor's N readings, and the counts of the whole replay.

    Times are in seconds from the start of the recording; a reading is NaN where the message lacked
    fields. An outcome is that of the time of receipt.

    Parameters
    ----------
    counts
        The number of readings by outcome, at the end: a late reading may have changed
        the outcome of another.
    undecodable
        The number of messages that were not those of the type, or too long.
    """

    counts: Mapping[Outcome, int]
    undecodable: int

    @property
    def fused(self) -> int:
        """The number of readings that moved the estimate."""
        return sum(count for outcome, count in self.counts.items() if outcome.accepted)


@dataclass(frozen=True)
class Truth:
    """True states (N, n) at times (N,), in seconds from the start."""

    time: Array
    state: Array

    def at(self, scenario: Scenario, time: Array) -> Array:
        """Return the states (M, n) at times (M,), on lines between those that are known.

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
        found = space.add(self.state[before], share[:, np.newaxis] * change)
        inside = (time >= self.time[0]) & (time <= self.time[-1])
        return np.where(inside[:, np.newaxis], found, np.nan)


@dataclass(frozen=True, repr=False)
class Replayed:
    """A recording as the estimator has seen it.

    Parameters
    ----------
    scenario
        The model and the sensors.
    start
        The time in nanoseconds that all others are counted from: when the first message of the
        recording was received, or in lockstep the stamp of the first step.
    duration
        Seconds from the first to the last message that was used; in lockstep, simulated seconds.
    lockstep
        Whether the recording is of a run in lockstep.
    sensors
        By name, those that are enabled.
    beliefs
        After each reading that corrected the estimate, or each step.
    inputs
        As they were received.
    restarts, repairs
        Of the estimator.
    smoothed
        The beliefs given all readings, if that was asked for.
    biases
        Of the sensors that have one, at the end.
    truth
        If the recording has it and its topic was named.
    notes
        Sentences on what is missing or damaged.
    arithmetic
        What computed the model and the sensors: C, CasADi or numpy, with the reason.
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

    def __repr__(self) -> str:
        rows = (f'{name}: {s.fused} of {len(s.nis)} fused' for name, s in self.sensors.items())
        what = ', '.join(rows)
        return f'Replayed({self.duration:.4g} s, {len(self.beliefs.time)} beliefs, {what})'
