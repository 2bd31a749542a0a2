# SPDX-License-Identifier: Apache-2.0
"""The unscented Kalman filter, with scaled sigma points.

R. van der Merwe, Sigma-Point Kalman Filters for Probabilistic Inference in Dynamic State-Space
Models (2004), section 3.2; means and differences go through the spaces, so angles are right.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Gaussian, Model, Sensor, Space, symmetric

from .factor import cholesky
from .filter import Correction, Plan
from .update import gain

Alpha = Annotated[float, About('spread of the sigma points', minimum=1e-4, maximum=10.0)]
Beta = Annotated[float, About('weight of the centre; 2 suits a Gaussian')]
Kappa = Annotated[float, About('second spread; n + kappa must be positive')]


@dataclass(frozen=True)
class UnscentedKalmanFilter:
    """A Kalman filter that carries 2n + 1 points through the model and the sensors.

    Parameters
    ----------
    model
        How the state moves.
    alpha, beta, kappa
        Spread, knowledge of the distribution, and second spread of the sigma points. With the
        defaults no weight is negative, so that no covariance can become indefinite.
    """

    model: Model
    alpha: float = 1.0
    beta: float = 0.0
    kappa: float = 1.0

    def __post_init__(self) -> None:
        if not self._scale > 0.0:
            raise ValueError(f'kappa: expected more than -{self._n}, got {self.kappa:g}')

    @property
    def _n(self) -> int:
        return self.model.state.size

    @property
    def _scale(self) -> float:
        """N + lambda."""
        return self.alpha**2 * (self._n + self.kappa)

    @cached_property
    def _weights(self) -> tuple[Array, Array]:
        """The weights of means and of covariances (2n + 1,)."""
        c, n = self._scale, self._n
        mean = np.full(2 * n + 1, 0.5 / c)
        mean[0] = 1.0 - n / c
        covariance = mean.copy()
        covariance[0] += 1.0 - self.alpha**2 + self.beta
        return mean, covariance

    def _points(self, belief: Gaussian) -> tuple[Array, int]:
        """Return the sigma points (2n + 1, n), and how often the covariance was repaired."""
        n = self._n
        L, _, repairs = cholesky(belief.covariance)
        spread = sqrt(self._scale) * L.T
        points = np.empty((2 * n + 1, n))
        points[0] = belief.mean
        points[1 : n + 1] = belief.mean + spread
        points[n + 1 :] = belief.mean - spread
        return points, belief.repairs + repairs

    def _spread(self, space: Space, points: Array) -> tuple[Array, Array, Array]:
        """Return mean, deviations, and deviations times weights of points."""
        means, covariances = self._weights
        mean = space.mean(points, means)
        deviations = space.subtract(points, mean)
        return mean, deviations, deviations.T * covariances

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Move every point by the model; P = sum of W d d' + Q."""
        model = self.model
        points, repairs = self._points(belief)
        mean, d, weighted = self._spread(model.state, model.step(points, u, dt))
        Q = model.transition(belief.mean, u, dt).Q
        return Gaussian(mean, symmetric(weighted.dot(d) + Q), repairs)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading: K = P_xy S^-1, P = P - K P_yx."""
        space = self.model.state
        points, repairs = self._points(belief)
        predicted, dy, weighted = self._spread(sensor.output, sensor.measure(points))
        dx = space.subtract(points, belief.mean)
        S = weighted.dot(dy) + sensor.covariance
        P_yx = weighted.dot(dx)
        innovation = sensor.output.subtract(y, predicted)
        K, nis = gain(S, P_yx, innovation)
        mean = space.wrap(belief.mean + K.dot(innovation))
        posterior = Gaussian(mean, symmetric(belief.covariance - K.dot(P_yx)), repairs)
        return Correction(posterior, innovation, S, nis)


def build(
    plan: Plan,
    alpha: Alpha = 1.0,
    beta: Beta = 0.0,
    kappa: Kappa = 1.0,
) -> UnscentedKalmanFilter:
    """Return the unscented Kalman filter of any model."""
    return UnscentedKalmanFilter(plan.model, alpha, beta, kappa)
