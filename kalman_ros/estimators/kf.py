# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter: R. E. Kalman, A New Approach to Linear Filtering and Prediction, 1960."""

from __future__ import annotations

from dataclasses import dataclass

from kalman_ros.core import Array, DiscreteLinearSystem, Gaussian, LinearSystem, unchecked
from kalman_ros.linear.kernels import affine, sandwich

from .correction import LinearUpdate
from .filter import Plan, linear_model, sampled_system


@dataclass(frozen=True)
class KalmanFilter(LinearUpdate):
    """The optimal estimator of a linear system with Gaussian noise.

    Steps are discretised exactly for their length, so readings may be irregular; sensors must be
    linear in the state.
    """

    model: LinearSystem | DiscreteLinearSystem

    def __post_init__(self) -> None:
        linear_model('kf', self.model)

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = F x + G u, P = F P F' + Q."""
        x, P = belief
        step = self.model.sampled(dt)
        F, G, Q = step.F, step.G, step.Q
        return unchecked((affine(F, x, G.dot(u)), sandwich(F, P, Q)))


def build(plan: Plan) -> KalmanFilter:
    """Return the Kalman filter of a linear model.

    Raises
    ------
    ValueError
        If the model is not linear.
    """
    return KalmanFilter(sampled_system('kf', plan))
