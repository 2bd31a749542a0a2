# SPDX-License-Identifier: Apache-2.0
"""The filter and sensors that follow from values of the parameters."""

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
    """A filter with its sensors and its initial belief.

    Parameters
    ----------
    filter, model
        Filter, a `SmoothableFilter`, and its model.
    sensors
        Sensors by name.
    initial
        Initial belief.
    biases
        Bias (k,) of the readings, by sensor.
    delays
        Delay of the stamps in seconds, by sensor.
    """

    filter: Filter
    model: Dynamics
    sensors: Mapping[str, Sensor]
    initial: Gaussian
    biases: Mapping[str, Array] = field(default_factory=dict)
    delays: Mapping[str, float] = field(default_factory=dict)


def candidate_filter(filters: Sequence[Filter]) -> Filter:
    """Return one filter of p candidates, which differ by their models, for beliefs (..., p, n).

    Sensors that differ, by noise or otherwise, must be combined by `candidate_sensor`.

    Raises
    ------
    ValueError
        If the filters are not of one kind, or of a kind without a likelihood.
    """
    first = filters[0]
    kinds = {type(filter) for filter in filters}
    if len(kinds) > 1 or not isinstance(first, SmoothableFilter):
        raise ValueError(
            'filter: expected several of one kind, such as kf, ekf or ukf, as candidates, '
            f'got {", ".join(sorted(kind.__name__ for kind in kinds))}'
        )
    template: Any = first
    batched: Filter = replace(
        template, model=candidate_model([filter.model for filter in filters])
    )
    return batched


#: Function that returns the candidate for values of all parameters, by name.
Build = Callable[[Mapping[str, float]], Candidate]


class Part(Sensor):
    """Selected coordinates of a candidate sensor, for a reading with missing values."""

    def __init__(self, sensor: Sensor, use: Array) -> None:
        self._sensor, self._use = sensor, np.flatnonzero(use)
        names = [sensor.output.names[index] for index in self._use]
        self.output, self.name = sensor.output.select(names), sensor.name
        R = sensor.covariance
        self.covariance = R[..., self._use[:, np.newaxis], self._use]

    def measure(self, x: Array) -> Array:
        """Return the selected coordinates of the reading (..., k)."""
        return self._sensor.measure(x)[..., self._use]
