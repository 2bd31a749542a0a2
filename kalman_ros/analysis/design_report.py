# SPDX-License-Identifier: Apache-2.0
"""The results of a design, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.stability import Mode
from kalman_ros.core import Array, OperatingPoint
from kalman_ros.linear.structure import Controllability, Observability
from kalman_ros.scenario import Scenario

from .input_loops import InputLoops, Together
from .path import Path


@dataclass(frozen=True)
class Estimator:
    """The Kalman filter in steady state, with every sensor at its own rate.

    Parameters
    ----------
    gains
        L (n, k) of each sensor, its mean over a period.
    modes
        Of the estimation error.
    std
        Standard deviation of the error of each state (n,), root mean square over a period.
    covariance
        Of the error after the readings (n, n), its mean over a period.
    """

    gains: Mapping[str, Array]
    modes: tuple[Mode, ...]
    std: Array
    covariance: Array


@dataclass(frozen=True)
class Regulator:
    """The regulator: its gains, its modes, and its loops, broken at each input and at all.

    ``together`` is None with a single input, where it equals ``at``.
    """

    feedback: Feedback
    modes: tuple[Mode, ...]
    loops: tuple[InputLoops, ...]
    together: Together | None


@dataclass(frozen=True)
class ClosedLoop:
    """Regulator and estimator together.

    Seconds after which a thousandth of the start is left.
    ----------
    settling_time
        Seconds after which a thousandth is left of the start.
    cost
        The mean cost per second; with an LQR the least that any controller can have.
    state_std, input_std
        Standard deviations of each state (n,) and input (m,), root mean square over a period.
    """

    settling_time: float
    cost: float
    state_std: Array
    input_std: Array


@dataclass(frozen=True)
class Prediction:
    """Standard deviations (N, n) of the errors of a Kalman filter at times (N,) in seconds.

    The first is the belief before any reading; the others are after the readings of each step.
    """

    time: Array
    std: Array


@dataclass(frozen=True)
class DesignReport:
    """The theory of a scenario.

    Parameters
    ----------
    scenario
        The scenario.
    point
        Where model and sensors are linearised.
    delay
        Seconds between a reading and the resulting input.
    modes
        Of the open loop.
    controllability, regulator
        None without an input.
    observability
        Of the sensors.
    estimator
        None if its error has no steady state, or one operating point cannot show it.
    closed_loop
        None without a regulator or an estimator.
    prediction
        From the initial belief on; along the path, if there is one.
    path
        A simulated path of a scenario that is not linear.
    """

    scenario: Scenario
    point: OperatingPoint
    delay: float
    modes: tuple[Mode, ...]
    controllability: Controllability | None
    observability: Observability
    regulator: Regulator | None
    estimator: Estimator | None
    closed_loop: ClosedLoop | None
    prediction: Prediction
    path: Path | None

    @property
    def sensor_std(self) -> dict[str, float]:
        """The standard deviation of the best sensor of each state that is measured directly."""
        found: dict[str, float] = {}
        for source in self.scenario.enabled.values():
            std = np.sqrt(source.sensor.covariance.diagonal()).tolist()
            for name, value in zip(source.sensor.output.names, std):
                if name in self.scenario.model.state.names:
                    found[name] = min(value, found.get(name, value))
        return found
