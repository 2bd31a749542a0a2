# SPDX-License-Identifier: Apache-2.0
"""What a filter is: two functions from belief to belief. No clock, no history, no mutation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from kalman_ros.core import (
    Array,
    Gaussian,
    LinearSystem,
    Model,
    Sensor,
    TimedSensor,
    is_due,
    period,
    ratio,
)


@dataclass(frozen=True)
class Correction:
    """What one reading did to a belief.

    Parameters
    ----------
    posterior
        The belief after the reading.
    innovation
        The reading minus its prediction (k,).
    innovation_covariance
        S (k, k), what the innovation was expected to scatter by.
    nis
        The normalised innovation squared, chi-square with k degrees of freedom if the filter is
        consistent (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
        Navigation, section 5.4).
    """

    posterior: Gaussian
    innovation: Array
    innovation_covariance: Array
    nis: float


class Filter(Protocol):
    """A recursive estimator of the state of a model."""

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return the belief ``dt`` seconds later, with the input ``u`` (m,) held."""
        ...

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return what the reading ``y`` (k,) of ``sensor`` makes of the belief.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the innovation covariance is not positive definite.
        """
        ...


@dataclass(frozen=True)
class Plan:
    """What a filter is built for: a model, and its sensors with their rates in a loop's."""

    model: Model
    sensors: Mapping[str, TimedSensor]
    rate: float

    @property
    def dt(self) -> float:
        """The length of a step in seconds."""
        return 1.0 / self.rate

    @property
    def period(self) -> int:
        """After how many steps the pattern of readings repeats."""
        return period([ratio(timed.rate, self.rate) for timed in self.sensors.values()])

    def due(self, step: int) -> list[str]:
        """Return the names of the sensors that read at ``step`` of a period."""
        return [
            name
            for name, timed in self.sensors.items()
            if is_due(step + self.period, ratio(timed.rate, self.rate))
        ]


def linear_system(filter: str, model: Model) -> LinearSystem:
    """Return the model, which the ``filter`` needs to be linear; ValueError if it is not."""
    if not isinstance(model, LinearSystem):
        raise ValueError(f'filter: {filter} needs a linear model, got {type(model).__name__}')
    return model
