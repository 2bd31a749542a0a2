# SPDX-License-Identifier: Apache-2.0
"""The interface of filters: functions from belief to belief; no clock, history or mutation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from kalman_ros.core import (
    Array,
    Dynamics,
    Gaussian,
    Sensor,
    TimedSensor,
    is_due,
    period,
    ratio,
)
from kalman_ros.core.model import MOST_SUBSTEPS
from kalman_ros.linear.kernels import kernels

if TYPE_CHECKING:
    from .correction import Correction  # imports scipy, which a `Plan` does not need


#: A covariance is predicted in at most this many parts, which bounds the time of a long step.
_MOST_PARTS = 100
#: Steps may exceed ``max_step`` by this rounding of a difference of stamps.
_ONE = 1.0 + 1e-9


def parts(model: Dynamics, dt: float) -> int:
    """Return the number of equal parts in which to predict a covariance over ``dt`` seconds.

    The mean of a nonlinear model is integrated in steps of at most ``max_step``, and a
    linearisation is valid no longer, so the covariance uses the same steps. Beyond the model's own
    resolution the path is unknown, and more parts gain nothing.
    """
    ratio = abs(dt) / model.max_step
    if model.is_discrete or not _ONE < ratio <= MOST_SUBSTEPS:
        return 1
    return ceil(min(ratio / _ONE, _MOST_PARTS))


def carried(model: Dynamics, points: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """Return points (p, ..., n) after ``dt`` seconds, and the noise covariance Q of the step.

    Over a step that is longer than ``max_step``, Q <- F Q F' + Q_k for each of its `parts`, along
    the path of the first point.
    """
    count = parts(model, dt)
    h = dt / count
    Q = model.noise_covariance(points[0], u, h)
    points = model.step(points, u, h)
    for _ in range(1, count):
        step = model.linearized_step(points[0], u, h)
        Q = kernels(points[0]).sandwich(step.F, Q, step.Q)
        points = model.step(points, u, h)
    return points, Q


class Prediction(NamedTuple):
    """A belief after a step in which errors moved by F (..., n, n) and noise added Q."""

    belief: Gaussian
    F: Array
    Q: Array


class Filter(ABC):
    """A recursive estimator of the state of a model.

    Beliefs may have leading axes, means (..., n) and covariances (..., n, n), with inputs
    (..., m) and readings (..., k), for a model and sensors that take them (`core.stacked`). A
    covariance (n, n) that all members share stays one. A member that fails becomes NaN; for one
    belief that is an error. What is known of a kind of filter are attributes of its class.
    """

    model: Dynamics

    #: Whether the model and the sensors have to be linear, and the model in continuous time.
    needs_linear: ClassVar[bool] = False
    needs_continuous: ClassVar[bool] = False
    #: Whether no gain has a smaller error; for a fixed gain, in steady state. The theory of the
    #: LQG loop holds for these.
    optimal: ClassVar[bool] = True
    #: Whether it has one gain for each sensor, by name in ``gains``.
    fixed_gain: ClassVar[bool] = False
    #: Whether beliefs are sums of Gaussians, which have no leading axes.
    mixture: ClassVar[bool] = False

    @classmethod
    def build(cls, plan: Plan) -> Filter:
        """Return the filter of a plan; further arguments of a class are its options.

        Raises
        ------
        ValueError
            If the plan does not suit; DesignError if there is no such filter.
        """
        found: Any = cls
        made: Filter = found(plan.model)
        return made

    @classmethod
    def placed_poles(cls, n: int, **options: Any) -> list[complex]:
        """Return the n poles in 1/s that a gain is designed for; none if by other means."""
        return []

    @abstractmethod
    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return the belief ``dt`` seconds later, with the input ``u`` (m,) held."""

    @abstractmethod
    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return the belief corrected by the reading ``y`` (k,) of ``sensor``.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the innovation covariance is not positive definite.
        """


class SmoothableFilter(Filter):
    """A filter whose steps are linear in the error, so that beliefs can be smoothed."""

    @abstractmethod
    def linearized(self, belief: Gaussian, u: Array, dt: float) -> Prediction:
        """Return what `predict` does, with the F and Q of the whole step."""


@dataclass(frozen=True)
class Plan:
    """What a filter is built for: a model, its sensors, their rates and the loop's rate."""

    model: Dynamics
    sensors: Mapping[str, TimedSensor]
    rate: float

    @property
    def linear(self) -> bool:
        """Whether the model and every sensor are linear."""
        return self.model.is_linear and all(timed.sensor.linear for timed in self.sensors.values())

    def computed_by(self, model: Dynamics, sensors: Mapping[str, Sensor]) -> Plan:
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


def check_linear(filter: str, model: Dynamics) -> None:
    """Raise ValueError if the model is not linear, as the ``filter`` needs."""
    if not model.is_linear:
        raise ValueError(f'filter: {filter} needs a linear model, got {type(model).__name__}')


def check_needs(name: str, kind: type[Filter], plan: Plan) -> None:
    """Raise ValueError if a plan is not as a kind of filter needs it."""
    if kind.needs_linear:
        check_linear(name, plan.model)
        for sensor, timed in plan.sensors.items():
            if not timed.sensor.linear:
                raise ValueError(
                    f'filter: {name} needs linear sensors, and the {type(timed.sensor).__name__} '
                    f"'{sensor}' is not declared linear; ekf and ukf take any"
                )
    if kind.needs_continuous and plan.model.is_discrete:
        raise ValueError(f'filter: {name} needs a model in continuous time')
