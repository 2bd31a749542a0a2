# SPDX-License-Identifier: Apache-2.0
"""The plan of a filter, and the parts of a long prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np

from kalman_ros.core import Array, Dynamics, Sensor, TimedSensor, is_due, period, ratio
from kalman_ros.core.model import MOST_SUBSTEPS
from kalman_ros.linear.kernels import kernels
from kalman_ros.linear.periodic import Phase, Readings

#: A covariance is predicted in at most this many parts, which bounds the time of a long step.
_MOST_PARTS = 100
#: Steps may exceed ``max_step`` by this factor, the rounding of a difference of stamps.
_ONE = 1.0 + 1e-9


def parts(model: Dynamics, dt: float) -> int:
    """Return the number of equal parts in which to predict a covariance over ``dt`` seconds.

    The mean of a nonlinear model is integrated in steps of at most ``max_step``, and a
    linearisation is valid no longer, so the covariance uses the same steps. Beyond the resolution
    of the model the path is unknown, and more parts gain nothing.
    """
    ratio = abs(dt) / model.max_step
    if model.is_discrete or not _ONE < ratio <= MOST_SUBSTEPS:
        return 1
    return ceil(min(ratio / _ONE, _MOST_PARTS))


def all_parts(model: Dynamics, dt: Array) -> Any:
    """Return the `parts` of each of steps dt (S,), a few of which differ."""
    lengths, which = np.unique(dt, return_inverse=True)
    return np.array([parts(model, length) for length in lengths.tolist()], dtype=int)[which]


def carried(model: Dynamics, points: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """Return the points (p, ..., n) after ``dt`` seconds, and the noise covariance Q of the step.

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


@dataclass(frozen=True)
class Plan:
    """The input of a filter design: a model, its sensors with rates, and the rate of the loop."""

    model: Dynamics
    sensors: Mapping[str, TimedSensor]
    rate: float

    @property
    def linear(self) -> bool:
        """Whether the model and every sensor are linear."""
        return self.model.is_linear and all(timed.sensor.linear for timed in self.sensors.values())

    def computed_by(self, model: Dynamics, sensors: Mapping[str, Sensor]) -> Plan:
        """Return the plan with another implementation of the same model and sensors."""
        timed = {
            name: replace(timed_sensor, sensor=sensors[name])
            for name, timed_sensor in self.sensors.items()
        }
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

    def phases(
        self, gains: Mapping[str, Array] | None = None
    ) -> tuple[list[str | None], list[Phase]]:
        """Return the phases of a period of a linear plan, and the sensor of each, or None.

        Sensors that are due together read in sequence, without time between them. They have the
        ``gains`` by name, if there are any.
        """
        n, chosen = self.model.state.size, gains or {}
        step = self.model.transition(*self.model.equilibrium, self.dt)
        names: list[str | None] = []
        phases = []
        for k in range(self.period):
            F, Q = step.F, step.Q
            due: Sequence[str | None] = self.due(k) or (None,)
            for name in due:
                readings = Readings(np.zeros((0, n)), np.zeros((0, 0)))
                if name is not None:
                    sensor = self.sensors[name].sensor
                    C = sensor.jacobian(np.zeros(n))
                    readings = Readings(C, sensor.covariance, chosen.get(name))
                names.append(name)
                phases.append(Phase(F, Q, readings))
                F, Q = np.eye(n), np.zeros((n, n))
        return names, phases


def check_linear(filter: str, model: Dynamics) -> None:
    """Raise ValueError if the model is not linear, as the ``filter`` needs."""
    if not model.is_linear:
        raise ValueError(f'filter: {filter} needs a linear model, got {type(model).__name__}')
