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

from kalman_ros.core import About, Array, Gaussian, Model, Sensor, Space, mirrored

from .correction import Correction
from .factor import cholesky
from .filter import Plan
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

    @cached_property
    def _n(self) -> int:
        return self.model.state.size

    @cached_property
    def _scale(self) -> float:
        """N + lambda."""
        return self.alpha**2 * (self._n + self.kappa)

    @cached_property
    def _directions(self) -> Array:
        """Where the sigma points lie, in standard deviations from the mean (2n + 1, n)."""
        eye = sqrt(self._scale) * np.eye(self._n)
        return np.vstack((np.zeros(self._n), eye, -eye))

    @cached_property
    def _weights(self) -> tuple[Array, Array]:
        """The weights of means (2n + 1,) and of covariances (2n + 1, 1)."""
        c, n = self._scale, self._n
        mean = np.full(2 * n + 1, 0.5 / c)
        mean[0] = 1.0 - n / c
        covariance = mean.copy()
        covariance[0] += 1.0 - self.alpha**2 + self.beta
        return mean, covariance[:, np.newaxis]

    def _offsets(self, belief: Gaussian) -> tuple[Array, int]:
        """Return the sigma points less the mean (2n + 1, n), and the repairs so far."""
        L, _, repairs = cholesky(belief.covariance)
        return self._directions.dot(L.T), belief.repairs + repairs

    def _spread(self, space: Space, points: Array) -> tuple[Array, Array, Array]:
        """Return mean, deviations, and deviations times weights of points."""
        means, covariances = self._weights
        mean = space.mean(points, means)
        deviations = space.subtract(points, mean)
        return mean, deviations, (covariances * deviations).T

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Move every point by the model; P = sum of W d d' + Q."""
        model = self.model
        offsets, repairs = self._offsets(belief)
        moved = model.step(belief.mean + offsets, u, dt)
        mean, d, weighted = self._spread(model.state, moved)
        Q = model.transition(belief.mean, u, dt).Q
        return Gaussian(mean, mirrored(weighted.dot(d) + Q), repairs)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading: K = P_xy S^-1, P = sum of W (dx - K dy) (dx - K dy)' + K R K'.

        This is P - K S K' as a sum of squares: what the form of Bucy and Joseph is to points.
        """
        space = self.model.state
        dx, repairs = self._offsets(belief)
        seen = sensor.measure(belief.mean + dx)
        predicted, dy, weighted = self._spread(sensor.output, seen)
        S = weighted.dot(dy) + sensor.covariance
        P_yx = weighted.dot(dx)
        innovation = sensor.output.subtract(y, predicted)
        K = gain(S, P_yx)
        mean = space.wrap(belief.mean + K.dot(innovation))
        left = dx - dy.dot(K.T)
        covariance = (self._weights[1] * left).T.dot(left) + K.dot(sensor.covariance).dot(K.T)
        posterior = Gaussian(mean, mirrored(covariance), repairs)
        return Correction(posterior, innovation, S)


def build(
    plan: Plan,
    alpha: Alpha = 1.0,
    beta: Beta = 0.0,
    kappa: Kappa = 1.0,
) -> UnscentedKalmanFilter:
    """Return the unscented Kalman filter of any model."""
    return UnscentedKalmanFilter(plan.model, alpha, beta, kappa)
