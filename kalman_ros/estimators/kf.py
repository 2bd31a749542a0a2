# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter: R. E. Kalman, A New Approach to Linear Filtering and Prediction, 1960."""

from __future__ import annotations

from dataclasses import dataclass

from kalman_ros.core import Array, Gaussian, LinearSystem, Sensor

from .correction import Correction
from .filter import Plan, linear_system
from .update import joseph_update


@dataclass(frozen=True)
class KalmanFilter:
    """The best estimator of a linear system with Gaussian noise.

    Every step is discretised exactly for its own length, so readings may come at any time.
    """

    system: LinearSystem

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = F x + G u, P = F P F' + Q."""
        step = self.system.sampled(dt)
        F, G, Q = step.F, step.G, step.Q
        x, P = belief.mean, belief.covariance
        mean, covariance = F.dot(x), F.dot(P).dot(F.T)
        mean += G.dot(u)
        covariance += Q
        return Gaussian(mean, covariance, belief.repairs)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading; the sensor must be linear in the state."""
        return joseph_update(belief, y, sensor, self.system.state)


def build(plan: Plan) -> KalmanFilter:
    """Return the Kalman filter of a linear model.

    Raises
    ------
    ValueError
        If the model is not linear.
    """
    return KalmanFilter(linear_system('kf', plan))
