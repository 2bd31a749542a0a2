# SPDX-License-Identifier: Apache-2.0
"""The extended Kalman filter: linearised about the estimate at every step.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
section 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass

from kalman_ros.core import Array, Gaussian, unchecked

from .filter import Plan
from .lapack import dgemm
from .update import LinearUpdate


@dataclass(frozen=True)
class ExtendedKalmanFilter(LinearUpdate):
    """A Kalman filter of the model and the sensors linearised about the estimate.

    The mean moves by the model itself, the covariance by the linear one.
    """

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = step(x, u), P = F P F' + Q."""
        x, P, repairs = belief
        step = self.model.transition(x, u, dt)
        F, Q = step.F, step.Q
        covariance = dgemm(1.0, dgemm(1.0, F, P), F, 1.0, Q, 0, 1)
        return unchecked((self.model.step(x, u, dt), covariance, repairs))


def build(plan: Plan) -> ExtendedKalmanFilter:
    """Return the extended Kalman filter of any model."""
    return ExtendedKalmanFilter(plan.model)
