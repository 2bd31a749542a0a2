# SPDX-License-Identifier: Apache-2.0
"""What a filter is: two functions from belief to belief. No clock, no history, no mutation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Protocol, Union

from kalman_ros.core import (
    Array,
    DiscreteLinearSystem,
    Gaussian,
    LinearSystem,
    Model,
    Sensor,
    TimedSensor,
    is_due,
    period,
    ratio,
)
from kalman_ros.core.model import MOST_SUBSTEPS

if TYPE_CHECKING:
    from .correction import Correction  # it needs scipy, and a `Plan` does not


#: A covariance is predicted in at most this many parts: a long silence costs milliseconds.
_MOST_PARTS = 100
#: A step that is longer than allowed by rounding, as a difference of stamps is, is one.
_ONE = 1.0 + 1e-9


def parts(model: Model, dt: float) -> int:
    """Return the number of equal parts in which to predict a covariance over ``dt`` seconds.

    The mean of a nonlinear model is integrated in steps of at most ``max_step``. A linearisation
    holds no longer than such a step, so the covariance goes along with the mean. Beyond what the
    model resolves itself, nothing is known of the path, and one part is as good as many.
    """
    ratio = abs(dt) / model.max_step
    if not _ONE < ratio <= MOST_SUBSTEPS:
        return 1
    return ceil(min(ratio / _ONE, _MOST_PARTS))


def carried(model: Model, points: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """Return points (p, n) after ``dt`` seconds, and the covariance Q (n, n) that noise adds.

    Over a step that is longer than ``max_step``, Q <- F Q F' + Q_k for each of its `parts`, along
    the path of the first point.
    """
    count = parts(model, dt)
    h = dt / count
    Q = model.transition(points[0], u, h).Q
    points = model.step(points, u, h)
    for _ in range(1, count):
        step = model.transition(points[0], u, h)
        Q = step.F @ Q @ step.F.T + step.Q
        points = model.step(points, u, h)
    return points, Q


#: The models whose steps are x' = F x + G u + w, whatever x and u are.
SampledLinear = Union[LinearSystem, DiscreteLinearSystem]


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
    def linear(self) -> bool:
        """Whether the model and every sensor are linear."""
        sensors_are = all(timed.sensor.linear for timed in self.sensors.values())
        return isinstance(self.model, (LinearSystem, DiscreteLinearSystem)) and sensors_are

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


def linear_model(filter: str, model: Model) -> SampledLinear:
    """Return the model; ValueError if it is not linear, as the ``filter`` needs."""
    if not isinstance(model, (LinearSystem, DiscreteLinearSystem)):
        kind = type(model).__name__
        raise ValueError(f'filter: {filter} needs a linear model, got {kind}')
    return model


def sampled_system(filter: str, plan: Plan) -> SampledLinear:
    """Return the model; ValueError if it or a sensor is not linear, as the ``filter`` needs."""
    model = linear_model(filter, plan.model)
    for name, timed in plan.sensors.items():
        if not timed.sensor.linear:
            kind = type(timed.sensor).__name__
            raise ValueError(
                f"filter: {filter} needs linear sensors, and the {kind} '{name}' is not "
                'declared linear; ekf and ukf take any'
            )
    return model


def linear_system(filter: str, plan: Plan) -> LinearSystem:
    """Return the model as `sampled_system` does; ValueError, too, if its time is sampled."""
    model = sampled_system(filter, plan)
    if not isinstance(model, LinearSystem):
        raise ValueError(f'filter: {filter} needs a model in continuous time')
    return model
