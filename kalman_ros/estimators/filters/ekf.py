# SPDX-License-Identifier: Apache-2.0
"""The extended Kalman filter: linearised about the estimate at every step.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
section 10.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from kalman_ros.core import Array, Gaussian, Sensor, unchecked
from kalman_ros.core.ordered_data import FirstSteps, OrderedData
from kalman_ros.estimators.diffuse import Diffuse
from kalman_ros.estimators.filter import LinearUpdate, Prediction
from kalman_ros.estimators.plan import all_parts, parts
from kalman_ros.linear.kernels import kernels


@dataclass(frozen=True)
class ExtendedKalmanFilter(LinearUpdate):
    """A Kalman filter of the model and the sensors linearised about the estimate.

    The model propagates the mean, and the linearised model propagates the covariance.
    """

    diffuse = True

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = step(x, u), P = F P F' + Q, in steps of the model's ``max_step``."""
        if isinstance(belief, Diffuse):
            return self.linearized(belief, u, dt).belief
        count = parts(self.model, dt) if abs(dt) > self.model.max_step else 1
        return self.model.predicted_moments(*belief, u, dt / count, count)

    def linearized(self, belief: Gaussian, u: Array, dt: float) -> Prediction:
        """Return the prediction, with F <- F_k F and Q <- F_k Q F_k' + Q_k over its steps."""
        if isinstance(belief, Diffuse):
            finite, F, Q = self.linearized(belief.finite, u, dt)
            return Prediction(belief.moved(finite, F), F, Q)
        (x, P), k = belief, kernels(belief[0])
        model, count = self.model, parts(self.model, dt)
        x, F, Q = model.linearized_step(x, u, dt / count)
        P = k.sandwich(F, P, Q)
        for _ in range(count - 1):
            x, F_k, Q_k = model.linearized_step(x, u, dt / count)
            P, Q, F = k.sandwich(F_k, P, Q_k), k.sandwich(F_k, Q, Q_k), k.scaled(F_k, F)
        return Prediction(unchecked((x, P)), F, Q)

    @property
    def has_first_steps(self) -> bool:
        """Whether C computes them for the model."""
        return self.linearises_once and self.model.has_first_steps

    def first_steps(
        self,
        belief: Gaussian,
        data: OrderedData,
        sensors: Sequence[Sensor],
        limits: Sequence[float],
    ) -> FirstSteps | None:
        """Return the steps before a reading beyond its limit; None where C has none."""
        whole = all_parts(self.model, data.dt)
        return self.model.first_steps(belief, data, whole, sensors, limits)


FILTER = ExtendedKalmanFilter
