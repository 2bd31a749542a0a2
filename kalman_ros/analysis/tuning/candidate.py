# SPDX-License-Identifier: Apache-2.0
"""What a set of values of the parameters builds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kalman_ros.core import Array, Gaussian, Model, Sensor
from kalman_ros.estimators.batch import candidate_sensor
from kalman_ros.estimators.batch.candidates import candidate_dynamics
from kalman_ros.estimators.filter import Filter


@dataclass(frozen=True)
class Candidate:
    """A filter with its sensors and its first belief.

    Parameters
    ----------
    filter, model
        The filter (kf, ekf or ukf), and its model.
    sensors
        By name.
    initial
        The first belief.
    biases
        By sensor, what its readings (k,) are too large by.
    delays
        By sensor, by how many seconds its stamps are too late.
    """

    filter: Filter
    model: Model
    sensors: Mapping[str, Sensor]
    initial: Gaussian
    biases: Mapping[str, Array] = field(default_factory=dict)
    delays: Mapping[str, float] = field(default_factory=dict)


#: Returns the candidate of the values of all parameters, by name.
Build = Callable[[Mapping[str, float]], Candidate]


class Earlier(Sensor):
    """A candidate sensor whose readings are of states that are a little earlier, x - d dx/dt.

    Parameters
    ----------
    sensor
        For states (..., p, n).
    models
        Of the p candidates.
    earlier
        By how many seconds, for each candidate (p,); short against what the model does.
    """

    def __init__(self, sensor: Sensor, models: Sequence[Model], earlier: Array) -> None:
        self.output, self.covariance, self.name = sensor.output, sensor.covariance, sensor.name
        self._sensor, self._dynamics = sensor, candidate_dynamics(models)
        self._earlier = earlier[:, np.newaxis]
        #: The input (m,) in effect, of copies of this sensor too.
        self.input: Array = np.zeros(models[0].input.size)

    def measure(self, x: Array) -> Array:
        """Return the readings (..., p, k)."""
        return self._sensor.measure(x - self._earlier * self._dynamics.derivative(x, self.input))


class Part(Sensor):
    """Some coordinates of a candidate sensor, for a reading with missing values."""

    def __init__(self, sensor: Sensor, use: Array) -> None:
        self._sensor, self._use = sensor, np.flatnonzero(use)
        names = [sensor.output.names[index] for index in self._use]
        self.output, self.name = sensor.output.select(names), sensor.name
        R = sensor.covariance
        self.covariance = R[..., self._use[:, np.newaxis], self._use]

    def measure(self, x: Array) -> Array:
        """Return these coordinates (..., k)."""
        return self._sensor.measure(x)[..., self._use]


def joined_sensor(name: str, candidates: Sequence[Candidate], earlier: Array) -> Sensor:
    """Return the sensor ``name`` of p candidates, of states ``earlier`` (p,) in seconds."""
    sensor = candidate_sensor([each.sensors[name] for each in candidates])
    if not earlier.any():
        return sensor
    return Earlier(sensor, [each.model for each in candidates], earlier)
