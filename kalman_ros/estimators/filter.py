# SPDX-License-Identifier: Apache-2.0
"""The interface of filters: two functions from belief to belief; no clock, history or mutation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
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
    from .correction import Correction  # imports scipy, which a `Plan` does not need


#: A covariance is predicted in at most this many parts, which bounds the time of a long step.
_MOST_PARTS = 100
#: Steps may exceed ``max_step`` by this rounding of a difference of stamps.
_ONE = 1.0 + 1e-9


def parts(model: Model, dt: float) -> int:
    """Return the number of equal parts in which to predict a covariance over ``dt`` seconds.

    The mean of a nonlinear model is integrated in steps of at most ``max_step``, and a
    linearisation is valid no longer, so the covariance uses the same steps. Beyond the model's own
    resolution the path is unknown, and more parts gain nothing.
    """
    ratio = abs(dt) / model.max_step
    if not _ONE < ratio <= MOST_SUBSTEPS:
        return 1
    return ceil(min(ratio / _ONE, _MOST_PARTS))


def carried(model: Model, points: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """Return points (p, n) after ``dt`` seconds, and the noise covariance Q (n, n) of the step.

    Over a step that is longer than ``max_step``, Q <- F Q F' + Q_k for each of its `parts`, along
    the path of the first point.
    """
    count = parts(model, dt)
    h = dt / count
    Q = model.noise_covariance(points[0], u, h)
    points = model.step(points, u, h)
    for _ in range(1, count):
        step = model.transition(points[0], u, h)
        Q = step.F @ Q @ step.F.T + step.Q
        points = model.step(points, u, h)
    return points, Q


#: Models whose steps are x' = F x + G u + w, independent of x and u.
SampledLinear = Union[LinearSystem, DiscreteLinearSystem]


class Filter(Protocol):
    """A recursive estimator of the state of a model."""

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return the belief ``dt`` seconds later, with the input ``u`` (m,) held."""
        ...

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return the belief corrected by the reading ``y`` (k,) of ``sensor``.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the innovation covariance is not positive definite.
        """
        ...


@dataclass(frozen=True)
class Plan:
    """What a filter is built for: a model, its sensors, their rates and the loop's rate."""

    model: Model
    sensors: Mapping[str, TimedSensor]
    rate: float

    @property
    def linear(self) -> bool:
        """Whether the model and every sensor are linear."""
        sensors_are = all(timed.sensor.linear for timed in self.sensors.values())
        return isinstance(self.model, (LinearSystem, DiscreteLinearSystem)) and sensors_are

    def computed_by(self, model: Model, sensors: Mapping[str, Sensor]) -> Plan:
        """Return the same plan with a model and sensors that compute the same."""
        timed = {name: replace(each, sensor=sensors[name]) for name, each in self.sensors.items()}
        return Plan(model, timed, self.rate)

    @property
    def dt(self) -> float:
        """The length of a step in seconds."""
        return 1.0 / self.rate

    @cached_property
    def shares(self) -> dict[str, Fraction]:
        """The share of the steps at which each sensor reads."""
        return {name: ratio(timed.rate, self.rate) for name, timed in self.sensors.items()}

    @cached_property
    def period(self) -> int:
        """The number of steps after which the pattern of readings repeats."""
        return period([*self.shares.values()])

    def due(self, step: int) -> list[str]:
        """Return the names of the sensors that read at ``step`` of a period."""
        return [name for name, share in self.shares.items() if is_due(step + self.period, share)]


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
    """Return the model as `sampled_system` does; ValueError also if it is discrete-time."""
    model = sampled_system(filter, plan)
    if not isinstance(model, LinearSystem):
        raise ValueError(f'filter: {filter} needs a model in continuous time')
    return model
