# SPDX-License-Identifier: Apache-2.0
"""What a set of values of the parameters builds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kalman_ros.core import Array, Dynamics, Gaussian, Sensor
from kalman_ros.core.candidates import candidate_model
from kalman_ros.estimators.filter import Filter, SmoothableFilter


@dataclass(frozen=True)
class Candidate:
    """A filter with its sensors and its first belief.

    Parameters
    ----------
    filter, model
        The filter, a `SmoothableFilter`, and its model.
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
    model: Dynamics
    sensors: Mapping[str, Sensor]
    initial: Gaussian
    biases: Mapping[str, Array] = field(default_factory=dict)
    delays: Mapping[str, float] = field(default_factory=dict)


def candidate_filter(filters: Sequence[Filter]) -> Filter:
    """Return p filters, which differ by the parameters of their models, for beliefs (..., p, n).

    Sensors that differ, by noise or otherwise, are those of `candidate_sensor`.

    Raises
    ------
    ValueError
        If they are not all of one kind, or of a kind without a likelihood.
    """
    first = filters[0]
    kinds = {type(each) for each in filters}
    if len(kinds) > 1 or not isinstance(first, SmoothableFilter):
        raise ValueError(
            'filter: expected several of one kind, such as kf, ekf or ukf, as candidates, '
            f'got {", ".join(sorted(kind.__name__ for kind in kinds))}'
        )
    one: Any = first
    whole: Filter = replace(one, model=candidate_model([each.model for each in filters]))
    return whole


#: Returns the candidate of the values of all parameters, by name.
Build = Callable[[Mapping[str, float]], Candidate]


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
