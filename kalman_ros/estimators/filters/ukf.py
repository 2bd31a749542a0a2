# SPDX-License-Identifier: Apache-2.0
"""The unscented Kalman filter, with scaled sigma points.

R. van der Merwe, Sigma-Point Kalman Filters for Probabilistic Inference in Dynamic State-Space
Models (2004), section 3.2; means and differences use the spaces, so angles are handled.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Annotated, Any

import numpy as np

from kalman_ros.core import About, Array, Dynamics, Gaussian, Sensor, Space, solve, unchecked
from kalman_ros.estimators.filter import Correction, Prediction, SmoothableFilter
from kalman_ros.estimators.plan import Plan, carried
from kalman_ros.linear.batched import sandwich, symmetric
from kalman_ros.linear.kernels import kernels

Alpha = Annotated[float, About('spread of the sigma points', minimum=1e-4, maximum=10.0)]
Beta = Annotated[float, About('weight of the centre; 2 suits a Gaussian')]
Kappa = Annotated[float, About('second spread; n + kappa must be positive')]


@dataclass(frozen=True)
class UnscentedKalmanFilter(SmoothableFilter):
    """A Kalman filter that propagates 2n + 1 points through the model and the sensors.

    The mean of an angle is the direction of the weighted sum of unit vectors: see `Space.mean`.

    Parameters
    ----------
    model
        The system model.
    alpha, beta, kappa
        Spread, knowledge of the distribution, and second spread of the sigma points. With the
        defaults no weight is negative, so that no covariance can become indefinite.
    """

    model: Dynamics
    alpha: float = 1.0
    beta: float = 0.0
    kappa: float = 1.0

    @classmethod
    def build(
        cls, plan: Plan, alpha: Alpha = 1.0, beta: Beta = 0.0, kappa: Kappa = 1.0
    ) -> UnscentedKalmanFilter:
        """Return the unscented Kalman filter of any model."""
        return cls(plan.model, alpha, beta, kappa)

    def __post_init__(self) -> None:
        if not self._scale > 0.0:
            raise ValueError(f'kappa: expected more than -{self._n}, got {self.kappa:g}')

    @cached_property
    def _n(self) -> int:
        return self.model.state.size

    @cached_property
    def _scale(self) -> float:
        """The sum n + lambda."""
        return self.alpha**2 * (self._n + self.kappa)

    @cached_property
    def directions(self) -> Array:
        """Offsets of the sigma points from the mean, in standard deviations (n, 2n + 1)."""
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

    def _points(self, belief: Gaussian, k: Any) -> tuple[Array, Array]:
        """Return the sigma points (2n + 1, ..., n) and their offsets (..., n, 2n + 1)."""
        x, P = belief
        offsets = k.scaled(k.repaired_factor(P), self.directions)
        return self.model.state.reached(k.points_about(x, offsets), x), offsets

    def _spread(self, space: Space, points: Array, k: Any) -> tuple[Array, Array]:
        """Return the mean (..., m) and deviations (..., m, 2n + 1) of points (2n + 1, ..., m)."""
        mean = space.mean(points, self.mean_weights)
        return mean, k.as_columns(space.subtract(points, mean))

    def _propagated(self, belief: Gaussian, u: Array, dt: float) -> tuple[Gaussian, Array, Array]:
        """Return the belief after a step, and the deviations before and after it."""
        k = kernels(belief[0])
        points, before = self._points(belief, k)
        propagated, Q = carried(self.model, points, u, dt)
        mean, d = self._spread(self.model.state, propagated, k)
        P = k.mirrored(k.moments(self._weights[self._n] * d, d, Q))
        return unchecked((mean, P)), before, d

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Propagate the sigma points through the model; P = sum of W d d' + Q."""
        return self._propagated(belief, u, dt)[0]

    def linearized(self, belief: Gaussian, u: Array, dt: float) -> Prediction:
        """Return the prediction; F is the slope of the points, and Q the remaining covariance.

        S. Sarkka, Unscented Rauch-Tung-Striebel Smoother, IEEE Trans. Automatic Control 53(3),
        2008: F P is the covariance of the state after the step with the state before.
        """
        predicted, before, after = self._propagated(belief, u, dt)
        P = belief.covariance
        F = _slope(P, (self._weights[self._n] * before) @ after.swapaxes(-1, -2))
        Q = symmetric(predicted.covariance - sandwich(F, P, np.zeros(())))
        return Prediction(predicted, F, Q)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading: K = P_xy S^-1, P = sum of W (dx - K dy) (dx - K dy)' + K R K'.

        This is P - K S K' as a sum of squares: the Joseph form for points.
        """
        x, R, k = belief[0], sensor.covariance, kernels(belief[0])
        points, dx = self._points(belief, k)
        predicted, dy = self._spread(sensor.output, sensor.measure(points), k)
        innovation = sensor.output.subtract(y, predicted)
        W_dy = self._weights[y.shape[-1]] * dy
        S = k.moments(W_dy, dy, R)
        K = k.divided(k.moments(W_dy, dx), S)
        left = k.remainder(dx, K, dy)
        P = k.mirrored(k.moments(self._weights[self._n] * left, left, k.through_gain(K, R)))
        moved = self.model.state.arrived(k.corrected(x, K, innovation), x, P)
        return Correction(unchecked(moved), innovation, S, K)


def _slope(P: Array, cross: Array) -> Array:
    """Return F (..., n, n) with F P = cross'; the smallest F if states are known exactly."""
    if cross.ndim > 2:
        P = np.broadcast_to(P, cross.shape)
        stacked = zip(P.reshape(-1, *P.shape[-2:]), cross.reshape(-1, *cross.shape[-2:]))
        return np.array([_slope(*pair) for pair in stacked]).reshape(cross.shape)
    try:
        return np.asarray(solve(P, cross).T)
    except np.linalg.LinAlgError:
        variances = P.diagonal()
        # scaled, so that the units of the states do not matter
        std = np.sqrt(np.where(variances > 0.0, variances, 1.0))
        scaled = np.linalg.lstsq(P / np.outer(std, std), cross / std[:, np.newaxis], rcond=None)[0]
        return np.asarray((scaled / std[:, np.newaxis]).T)


class _Repeated(dict[int, Array]):
    """A row (p,) repeated k times (k, p), by k, since the broadcasting of numpy takes longer."""

    def __init__(self, row: Array) -> None:
        super().__init__()
        self._row = row

    def __missing__(self, k: int) -> Array:
        """Return the row ``k`` times, cached for the next call."""
        self[k] = np.asfortranarray(np.tile(self._row, (k, 1)))
        return self[k]


FILTER = UnscentedKalmanFilter
