# SPDX-License-Identifier: Apache-2.0
"""The input of a diagnosis: a recording and the results of the filter, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, Protocol

import numpy as np

from kalman_ros.analysis.records import Beliefs, InputRecord, SensorRecord
from kalman_ros.core import Array
from kalman_ros.scenario import Scenario, build

from .model_noise import noisier


class Rerun(Protocol):
    """A function that replays a recording, or its first seconds, with changed parameters."""

    def __call__(self, changes: Mapping[str, Any], seconds: float = inf) -> Evidence:
        """Return the evidence of the replay; a change to None removes a parameter of the file."""
        ...


@dataclass(frozen=True)
class Evidence:
    """A recording, the results of a filter, and a function that replays it.

    Parameters
    ----------
    parameters
        Parameters of the estimator, flat, by their names in the parameter file.
    scenario
        Scenario with these parameters.
    sensors
        Records of the sensors, by name.
    inputs
        Inputs that the estimator received.
    beliefs
        Beliefs of the estimator.
    rerun
        Function that replays the recording, or its first seconds, with changed parameters, by
        their names in the file.
    headerless
        Sensors whose messages have no place for a stamp.
    forces
        Specific force (3,) at the start, in m/s^2, by the sensor, or the input, whose messages
        have one, in their axes.
    origin
        Time from which all others are counted, in nanoseconds.
    noise_factor
        By how much the process noise of the model is larger than its class has it.
    """

    parameters: Mapping[str, Any]
    scenario: Scenario
    sensors: Mapping[str, SensorRecord]
    inputs: InputRecord
    beliefs: Beliefs
    rerun: Rerun
    headerless: frozenset[str] = frozenset()
    forces: Mapping[str, Array] = field(default_factory=dict)
    origin: int = 0
    noise_factor: float = 1.0

    def with_sensor(self, name: str, record: SensorRecord) -> Evidence:
        """Return the evidence with another record of one sensor."""
        return replace(self, sensors={**self.sensors, name: record})

    def with_values(self, name: str, value: Array) -> Evidence:
        """Return the evidence with other values (N, k) of one sensor."""
        return self.with_sensor(name, replace(self.sensors[name], value=value))

    def with_column(self, name: str, index: int, column: Array) -> Evidence:
        """Return the evidence with other values (N,) of a coordinate of one sensor."""
        value = self.sensors[name].value.copy()
        value[:, index] = column
        return self.with_values(name, value)

    def without(self, name: str, rows: Any) -> Evidence:
        """Return the evidence without some readings of one sensor, by index or mask."""
        value = self.sensors[name].value.copy()
        value[rows] = np.nan
        return self.with_values(name, value)

    def between(self, begin: float, end: float) -> Evidence:
        """Return the evidence of the messages received from ``begin`` to ``end`` (s)."""
        sensors = {
            name: record.select((record.received >= begin) & (record.received <= end))
            for name, record in self.sensors.items()
        }
        held = np.flatnonzero(self.inputs.received < begin)[-1:]  # it acts in the part
        kept = np.concatenate(
            (held, np.flatnonzero((self.inputs.received >= begin) & (self.inputs.received <= end)))
        )
        received, stamp, value = self.inputs.received, self.inputs.stamp, self.inputs.value
        inputs = InputRecord(received[kept], stamp[kept], value[kept])
        return replace(self, sensors=sensors, inputs=inputs)

    def with_inputs(self, value: Array) -> Evidence:
        """Return the evidence with other values (N, m) of the inputs."""
        return replace(self, inputs=replace(self.inputs, value=value))

    def with_late_inputs(self, seconds: float) -> Evidence:
        """Return the evidence with inputs that act ``seconds`` after their stamps."""
        return replace(self, inputs=replace(self.inputs, stamp=self.inputs.stamp + seconds))

    def adopting(self, changes: Mapping[str, Any]) -> Evidence:
        """Return the evidence with other parameters, without a replay.

        The readings of a sensor with a changed noise get the new covariance; all other readings
        keep the covariances with which they were fused.

        Raises
        ------
        ValueError
            If the changes are invalid.
        """
        parameters = changed(self.parameters, changes)
        scenario = build(parameters, with_law=False)
        scenario = replace(scenario, model=noisier(scenario.model, self.noise_factor))
        sensors = dict(self.sensors)
        for name, record in self.sensors.items():
            if f'{name}.noise' in changes and name in scenario.sensors and len(record):
                R = scenario.sensors[name].sensor.covariance
                covariance = np.broadcast_to(R, (len(record), *R.shape)).copy()
                sensors[name] = replace(record, covariance=covariance)
        return replace(self, parameters=parameters, scenario=scenario, sensors=sensors)

    def noisier(self, factor: float) -> Evidence:
        """Return the evidence with a model whose process noise is larger by a factor."""
        whole = self.noise_factor * factor
        scenario = replace(self.scenario, model=noisier(self.scenario.model, whole))
        return replace(self, scenario=scenario, noise_factor=whole)

    @property
    def start(self) -> float:
        """Start of the recording by the clock of the recorder, in seconds."""
        begins = [record.received[0] for record in self.sensors.values() if len(record)]
        return float(min(begins, default=0.0))

    @property
    def duration(self) -> float:
        """Duration of the recording by the clock of the recorder, in seconds."""
        ends = [record.received[-1] for record in self.sensors.values() if len(record)]
        return float(max(ends, default=self.start)) - self.start


def changed(parameters: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with changes; a change to None removes a parameter."""
    merged = {**parameters, **changes}
    return {name: value for name, value in merged.items() if value is not None}


def misfit(evidence: Evidence) -> float:
    """Return -2 log likelihood of all innovations, the sum of nu' S^-1 nu + log |2 pi S|.

    F. C. Schweppe, Evaluation of Likelihood Functions for Gaussian Signals, IEEE Trans.
    Information Theory 11(1), 1965.
    """
    return sum(float(np.nansum(_misfit_terms(record))) for record in evidence.sensors.values())


def improvement(before: Evidence, after: Evidence) -> float:
    """Return the reduction of the misfit from one replay to another.

    Only readings with an innovation in both replays count. The replays may differ in length. The
    result is NaN if no reading counts.
    """
    total, compared = 0.0, 0
    for name, record in before.sensors.items():
        other = after.sensors.get(name)
        count = 0 if other is None else min(len(record), len(other))
        if other is not None and np.array_equal(record.received[:count], other.received[:count]):
            change = _misfit_terms(record)[:count] - _misfit_terms(other)[:count]
            total += float(np.nansum(change))
            compared += int(np.isfinite(change).sum())
    return total if compared else float('nan')


def _misfit_terms(record: SensorRecord) -> Array:
    """Return the term of each reading in the misfit (N,); NaN without an innovation."""
    known = np.isfinite(record.nis)
    terms = np.full(len(record), np.nan)
    S = record.innovation_covariance[known]
    if len(S):
        terms[known] = record.nis[known] + np.linalg.slogdet(2.0 * np.pi * S)[1]
    return terms
