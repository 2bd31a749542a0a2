# SPDX-License-Identifier: Apache-2.0
"""The extended Kalman filter: linearised about the estimate at every step.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
section 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass

from kalman_ros.core import Array, Gaussian, Model, Sensor

from .correction import Correction
from .filter import Plan
from .update import joseph_update


@dataclass(frozen=True)
class ExtendedKalmanFilter:
    """A Kalman filter of the model and the sensors linearised about the estimate.

    The mean moves by the model itself, the covariance by the linear one.
    """

    model: Model

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = step(x, u), P = F P F' + Q."""
        x, P = belief.mean, belief.covariance
        step = self.model.transition(x, u, dt)
        F, Q = step.F, step.Q
        return Gaussian(self.model.step(x, u, dt), F.dot(P).dot(F.T) + Q, belief.repairs)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading."""
        return joseph_update(belief, y, sensor, self.model.state)


def build(plan: Plan) -> ExtendedKalmanFilter:
    """Return the extended Kalman filter of any model."""
    return ExtendedKalmanFilter(plan.model)
