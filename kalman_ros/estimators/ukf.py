# SPDX-License-Identifier: Apache-2.0
"""The unscented Kalman filter, with scaled sigma points.

R. van der Merwe, Sigma-Point Kalman Filters for Probabilistic Inference in Dynamic State-Space
Models (2004), section 3.2; means and differences use the spaces, so angles are handled.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Gaussian, Model, Sensor, Space, unchecked
from kalman_ros.linear.factor import cholesky
from kalman_ros.linear.kernels import (
    corrected,
    divided,
    mirrored,
    moments,
    plus_each,
    remainder,
    scaled,
    through_gain,
)

from .correction import Correction
from .filter import Plan, carried

Alpha = Annotated[float, About('spread of the sigma points', minimum=1e-4, maximum=10.0)]
Beta = Annotated[float, About('weight of the centre; 2 suits a Gaussian')]
Kappa = Annotated[float, About('second spread; n + kappa must be positive')]


@dataclass(frozen=True)
class UnscentedKalmanFilter:
    """A Kalman filter that propagates 2n + 1 points through the model and the sensors.

    Parameters
    ----------
    model
        The system model.
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
    def directions(self) -> Array:
        """Where the sigma points lie, in standard deviations from the mean (n, 2n + 1)."""
        eye = sqrt(self._scale) * np.eye(self._n)
        return np.asfortranarray(np.hstack((np.zeros((self._n, 1)), eye, -eye)))

    @cached_property
    def mean_weights(self) -> Array:
        """The weights of means (2n + 1,)."""
        c, n = self._scale, self._n
        weights = np.full(2 * n + 1, 0.5 / c)
        weights[0] = 1.0 - n / c
        return weights

    @cached_property
    def covariance_weights(self) -> Array:
        """The weights of covariances (2n + 1,)."""
        weights: Array = self.mean_weights.copy()
        weights[0] += 1.0 - self.alpha**2 + self.beta
        return weights

    @cached_property
    def _weights(self) -> _Repeated:
        """The weights of covariances, repeated for vectors of k numbers (k, 2n + 1)."""
        return _Repeated(self.covariance_weights)

    def _offsets(self, P: Array) -> Array:
        """Return the sigma points minus the mean (n, 2n + 1)."""
        L, _, _ = cholesky(P)
        return scaled(L, self.directions)

    def _points(self, x: Array, offsets: Array) -> Array:
        """Return the sigma points (2n + 1, n)."""
        return self.model.state.reached(plus_each(offsets, x).T, x)

    def _spread(self, space: Space, points: Array) -> tuple[Array, Array]:
        """Return mean (k,) and deviations (k, 2n + 1) of ``points`` (2n + 1, k)."""
        mean = space.mean(points, self.mean_weights)
        return mean, space.subtract(points, mean).T

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Move every point by the model; P = sum of W d d' + Q."""
        x, P = belief
        points = self._points(x, self._offsets(P))
        moved, Q = carried(self.model, points, u, dt)
        mean, d = self._spread(self.model.state, moved)
        W = self._weights[self._n]
        return unchecked((mean, mirrored(moments(W * d, d, Q))))

    def cross_covariance(self, belief: Gaussian, u: Array, dt: float) -> Array:
        """Return the covariance (n, n) of current and predicted state, for smoothing."""
        offsets = self._offsets(belief.covariance)
        moved = self.model.step(self._points(belief.mean, offsets), u, dt)
        _, d = self._spread(self.model.state, moved)
        cross: Array = (self._weights[self._n] * offsets) @ d.T
        return cross

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading: K = P_xy S^-1, P = sum of W (dx - K dy) (dx - K dy)' + K R K'.

        This is P - K S K' as a sum of squares: the Joseph form for points.
        """
        (x, P), R = belief, sensor.covariance.T
        dx = self._offsets(P)
        predicted, dy = self._spread(sensor.output, sensor.measure(self._points(x, dx)))
        innovation = sensor.output.subtract(y, predicted)
        W_dy = self._weights[y.size] * dy
        S = moments(W_dy, dy, R)
        K = divided(moments(W_dy, dx), S)
        left = remainder(dx, K, dy)
        P = mirrored(moments(self._weights[self._n] * left, left, through_gain(K, R)))
        moved = self.model.state.arrived(corrected(x, K, innovation), x, P)
        return Correction(unchecked(moved), innovation, S)


class _Repeated(dict[int, Array]):
    """A row (p,) repeated k times (k, p), by k; numpy's broadcasting takes longer."""

    def __init__(self, row: Array) -> None:
        super().__init__()
        self._row = row

    def __missing__(self, k: int) -> Array:
        """Return the row ``k`` times, cached for the next call."""
        self[k] = np.asfortranarray(np.tile(self._row, (k, 1)))
        return self[k]


def build(
    plan: Plan,
    alpha: Alpha = 1.0,
    beta: Beta = 0.0,
    kappa: Kappa = 1.0,
) -> UnscentedKalmanFilter:
    """Return the unscented Kalman filter of any model."""
    return UnscentedKalmanFilter(plan.model, alpha, beta, kappa)
