# SPDX-License-Identifier: Apache-2.0
"""The results of a design."""

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
    """The Kalman filter, or the observer with fixed gains, in steady state.

    Each sensor has its own rate.

    Parameters
    ----------
    gains
        Gain L (n, k) of each sensor, averaged over a period.
    modes
        Modes of the estimation error.
    std
        Standard deviation of the error of each state (n,), root mean square over a period.
    covariance
        Covariance of the error after the readings (n, n), averaged over a period.
    """

    gains: Mapping[str, Array]
    modes: tuple[Mode, ...]
    std: Array
    covariance: Array


@dataclass(frozen=True)
class Regulator:
    """The regulator: its gains, its modes, and its loops broken at each input and at all inputs.

    ``together`` is None for a single input, where it would equal the loop of that input.
    """

    feedback: Feedback
    modes: tuple[Mode, ...]
    loops: tuple[InputLoops, ...]
    together: Together | None


@dataclass(frozen=True)
class ClosedLoop:
    """The loop of regulator and estimator.

    Parameters
    ----------
    settling_time
        Time in seconds after which a thousandth of the initial error is left.
    cost
        Mean cost per second; for an LQR, the least that any controller can achieve.
    state_std, input_std
        Standard deviation of each state (n,) and input (m,), root mean square over a period.
    """

    settling_time: float
    cost: float
    state_std: Array
    input_std: Array


@dataclass(frozen=True)
class Prediction:
    """Standard deviations (N, n) of the errors of a Kalman filter at times (N,) in seconds.

    The first row is the belief before any reading; the others are after the readings of each step.
    """

    time: Array
    std: Array


@dataclass(frozen=True)
class DesignReport:
    """The theory of a scenario.

    Parameters
    ----------
    scenario
        Scenario that is analysed.
    point
        Operating point about which model and sensors are linearised.
    delay
        Time in seconds between a reading and the resulting input.
    modes
        Modes of the open loop.
    controllability, regulator
        Controllability and regulator; None without an input.
    observability
        Observability of the state by the sensors.
    estimator
        Estimator; None if its error has no steady state, or if one operating point cannot show it.
    closed_loop
        Closed loop; None without a regulator or an estimator.
    prediction
        Predicted errors from the initial belief on; along the path, if there is one.
    path
        Simulated path of a scenario that is not linear.
    unlimited
        How far each state may begin below and above the equilibrium (n, 2), the others at rest,
        so that no limit of inputs or states acts; None without an input.
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
    unlimited: Array | None = None

    @property
    def sensor_std(self) -> dict[str, float]:
        """Standard deviation of the best sensor of each state that is measured directly."""
        best: dict[str, float] = {}
        for source in self.scenario.enabled.values():
            std = np.sqrt(source.sensor.covariance.diagonal()).tolist()
            for name, value in zip(source.sensor.output.names, std):
                if name in self.scenario.model.state.names:
                    best[name] = min(value, best.get(name, value))
        return best
