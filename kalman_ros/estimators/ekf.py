# SPDX-License-Identifier: Apache-2.0
"""The extended Kalman filter: linearised about the estimate at every step.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
section 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass

from kalman_ros.core import Array, Gaussian, unchecked
from kalman_ros.linear.kernels import sandwich

from .correction import LinearUpdate
from .filter import Plan, parts


@dataclass(frozen=True)
class ExtendedKalmanFilter(LinearUpdate):
    """A Kalman filter of the model and the sensors linearised about the estimate.

    The mean moves by the model itself, the covariance by the linear one.
    """

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = step(x, u), P = F P F' + Q, in steps of the model's ``max_step``."""
        x, P = belief
        model, count = self.model, parts(self.model, dt)
        h = dt / count
        for _ in range(count):
            x, F, Q = model.linearized_step(x, u, h)
            P = sandwich(F, P, Q)
        return unchecked((x, P))


def build(plan: Plan) -> ExtendedKalmanFilter:
    """Return the extended Kalman filter of any model."""
    return ExtendedKalmanFilter(plan.model)
