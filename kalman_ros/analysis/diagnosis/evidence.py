# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis looks at: a recording and what the filter made of it, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Protocol

import numpy as np

from kalman_ros.analysis.records import Beliefs, InputRecord, SensorRecord
from kalman_ros.core import Array
from kalman_ros.scenario import Scenario, build


class Rerun(Protocol):
    """Replays a recording, or its first seconds, with some parameters changed."""

    def __call__(self, changes: Mapping[str, Any], seconds: float = inf) -> Evidence:
        """Return the evidence; a parameter of the file that is changed to None is removed."""
        ...


@dataclass(frozen=True)
class Evidence:
    """A recording, what a filter made of it, and a way to replay it with other parameters.

    Parameters
    ----------
    parameters
        The estimator's parameters, flat, as the parameter file has them.
    scenario
        The scenario that they build.
    sensors
        By name.
    inputs
        The inputs that the estimator received.
    beliefs
        The estimates.
    rerun
        Replays the recording, or its first seconds, with some parameters changed, by their names
        in the file.
    """

    parameters: Mapping[str, Any]
    scenario: Scenario
    sensors: Mapping[str, SensorRecord]
    inputs: InputRecord
    beliefs: Beliefs
    rerun: Rerun

    def with_sensor(self, name: str, record: SensorRecord) -> Evidence:
        """Return the evidence with another record of one sensor."""
        return replace(self, sensors={**self.sensors, name: record})

    def adopting(self, changes: Mapping[str, Any]) -> Evidence:
        """Return the evidence with other parameters, not replayed.

        Readings keep the covariances that they were fused with, scaled to a changed noise.

        Raises
        ------
        ValueError
            If the changes do not fit.
        """
        parameters = changed(self.parameters, changes)
        scenario = build(parameters, with_law=False)
        sensors = dict(self.sensors)
        for name, record in self.sensors.items():
            if f'{name}.noise' in changes and name in scenario.sensors and len(record):
                R = scenario.sensors[name].sensor.covariance
                covariance = np.broadcast_to(R, (len(record), *R.shape)).copy()
                sensors[name] = replace(record, covariance=covariance)
        return replace(self, parameters=parameters, scenario=scenario, sensors=sensors)

    @property
    def start(self) -> float:
        """When the recording begins, by the recorder's clock, in seconds."""
        begins = [each.received[0] for each in self.sensors.values() if len(each)]
        return float(min(begins, default=0.0))

    @property
    def duration(self) -> float:
        """How long the recording is, by the recorder's clock, in seconds."""
        ends = [each.received[-1] for each in self.sensors.values() if len(each)]
        return float(max(ends, default=self.start)) - self.start


def changed(parameters: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with changes; one that is changed to None is removed."""
    merged = {**parameters, **changes}
    return {name: value for name, value in merged.items() if value is not None}


def misfit(evidence: Evidence) -> float:
    """Return -2 log likelihood of all innovations, the sum of nu' S^-1 nu + log |2 pi S|.

    F. C. Schweppe, Evaluation of Likelihood Functions for Gaussian Signals, IEEE Trans.
    Information Theory 11(1), 1965.
    """
    return sum(float(np.nansum(_terms(record))) for record in evidence.sensors.values())


def improvement(before: Evidence, after: Evidence) -> float:
    """Return by how much the misfit of a replay is smaller than that of another.

    Only readings with an innovation in both count, and one may end before the other; NaN if there
    are none.
    """
    total, compared = 0.0, 0
    for name, record in before.sensors.items():
        other = after.sensors.get(name)
        count = 0 if other is None else min(len(record), len(other))
        if other is not None and np.array_equal(record.received[:count], other.received[:count]):
            change = _terms(record)[:count] - _terms(other)[:count]
            total += float(np.nansum(change))
            compared += int(np.isfinite(change).sum())
    return total if compared else float('nan')


def _terms(record: SensorRecord) -> Array:
    """Return what each reading adds to the misfit (N,), NaN without an innovation."""
    known = np.isfinite(record.nis)
    terms = np.full(len(record), np.nan)
    S = record.innovation_covariance[known]
    if len(S):
        terms[known] = record.nis[known] + np.linalg.slogdet(2.0 * np.pi * S)[1]
    return terms
