# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter: R. E. Kalman, A New Approach to Linear Filtering and Prediction, 1960."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, DiscreteLinearSystem, Gaussian, LinearSystem, Sensor
from kalman_ros.core.ordered_data import FirstSteps, OrderedData
from kalman_ros.estimators.diffuse import Diffuse
from kalman_ros.estimators.filter import LinearUpdate, Prediction
from kalman_ros.estimators.plan import check_linear


@dataclass(frozen=True)
class KalmanFilter(LinearUpdate):
    """The optimal estimator of a linear system with Gaussian noise.

    Steps are discretised exactly for their length, so readings may be irregular; sensors must be
    linear in the state.
    """

    model: LinearSystem | DiscreteLinearSystem
    needs_linear = True
    diffuse = True

    def __post_init__(self) -> None:
        check_linear('kf', self.model)

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = F x + G u, P = F P F' + Q."""
        if isinstance(belief, Diffuse):
            return self.linearized(belief, u, dt).belief
        return self.model.predicted_moments(*belief, u, dt)

    def linearized(self, belief: Gaussian, u: Array, dt: float) -> Prediction:
        """Return the prediction with the F and Q of the step."""
        F, _, Q = self.model.sampled(dt)
        if isinstance(belief, Diffuse):
            moved = belief.moved(self.predict(belief.finite, u, dt), F)
            return Prediction(moved, F, Q)
        return Prediction(self.predict(belief, u, dt), F, Q)

    @property
    def has_first_steps(self) -> bool:
        """Whether C computes them for the model."""
        return self.model.has_first_steps

    def first_steps(
        self,
        belief: Gaussian,
        data: OrderedData,
        sensors: Sequence[Sensor],
        limits: Sequence[float],
    ) -> FirstSteps | None:
        """Return the steps before a reading beyond its limit; None where C has none."""
        once = np.ones(len(data.dt), dtype=int)
        return self.model.first_steps(belief, data, once, sensors, limits)


FILTER = KalmanFilter
