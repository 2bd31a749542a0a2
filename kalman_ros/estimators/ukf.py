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

from kalman_ros.core import (
    About,
    Array,
    Gaussian,
    Model,
    Sensor,
    Space,
    identity,
    unchecked,
)
from kalman_ros.linear.factor import cholesky
from kalman_ros.linear.lapack import dgemm, dgemv, dger, dsymm

from .correction import Correction
from .filter import Plan, carried
from .update import transposed_gain

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
        """Where the sigma points lie, in standard deviations from the mean (n, 2n + 1)."""
        eye = sqrt(self._scale) * np.eye(self._n)
        return np.asfortranarray(np.hstack((np.zeros((self._n, 1)), eye, -eye)))

    @cached_property
    def _ones(self) -> Array:
        """A one for each sigma point (2n + 1,)."""
        return np.ones(2 * self._n + 1)

    @cached_property
    def _mean_weights(self) -> Array:
        """The weights of means (2n + 1,)."""
        c, n = self._scale, self._n
        weights = np.full(2 * n + 1, 0.5 / c)
        weights[0] = 1.0 - n / c
        return weights

    @cached_property
    def _weights(self) -> _Repeated:
        """The weights of covariances, k times for vectors of k numbers (k, 2n + 1)."""
        weights = self._mean_weights.copy()
        weights[0] += 1.0 - self.alpha**2 + self.beta
        return _Repeated(weights)

    def _offsets(self, belief: Gaussian) -> tuple[Array, int]:
        """Return the sigma points less the mean (n, 2n + 1), and the repairs so far."""
        L, _, repairs = cholesky(belief.covariance)
        return dgemm(1.0, L, self._directions), belief.repairs + repairs

    def _points(self, mean: Array, offsets: Array) -> Array:
        """Return the sigma points (2n + 1, n)."""
        points: Array = dger(1.0, mean, self._ones, 1, 1, offsets).T
        return points

    def _spread(self, space: Space, points: Array) -> tuple[Array, Array]:
        """Return mean (k,) and deviations (k, 2n + 1) of ``points`` (2n + 1, k)."""
        mean = space.mean(points, self._mean_weights)
        deviations = dger(-1.0, mean, self._ones, 1, 1, points.T)
        return mean, space.wrap(deviations.T).T

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Move every point by the model; P = sum of W d d' + Q."""
        model = self.model
        offsets, repairs = self._offsets(belief)
        moved, Q = carried(model, self._points(belief.mean, offsets), u, dt)
        mean, d = self._spread(model.state, moved)
        covariance = dgemm(1.0, self._weights[self._n] * d, d, 1.0, Q, 0, 1)
        return unchecked((mean, dsymm(1.0, covariance, identity(self._n)), repairs))

    def cross_covariance(self, belief: Gaussian, u: Array, dt: float) -> Array:
        """Return the covariance (n, n) of the state now with the one predicted, for smoothing."""
        offsets, _ = self._offsets(belief)
        moved = self.model.step(self._points(belief.mean, offsets), u, dt)
        _, d = self._spread(self.model.state, moved)
        cross: Array = (self._weights[self._n] * offsets) @ d.T
        return cross

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading: K = P_xy S^-1, P = sum of W (dx - K dy) (dx - K dy)' + K R K'.

        This is P - K S K' as a sum of squares: what the form of Bucy and Joseph is to points.
        """
        x, R = belief.mean, sensor.covariance.T
        dx, repairs = self._offsets(belief)
        predicted, dy = self._spread(sensor.output, sensor.measure(self._points(x, dx)))
        innovation = sensor.output.subtract(y, predicted)
        weighted = self._weights[y.size] * dy
        S = dgemm(1.0, weighted, dy, 1.0, R, 0, 1)
        Kt = transposed_gain(S, dgemm(1.0, weighted, dx, 0.0, None, 0, 1))
        mean = dgemv(1.0, Kt, innovation, 1.0, x, 0, 1, 0, 1, 1)  # x + K innovation
        left = dgemm(-1.0, Kt, dy, 1.0, dx, 1, 0, 1)  # dx - K dy
        KRK = dgemm(1.0, dgemm(1.0, Kt, R, 0.0, None, 1), Kt)
        covariance = dgemm(1.0, self._weights[self._n] * left, left, 1.0, KRK, 0, 1, 1)
        P = dsymm(1.0, covariance, identity(self._n))
        posterior = unchecked((self.model.state.wrap(mean), P, repairs))
        return Correction(posterior, innovation, S)


class _Repeated(dict[int, Array]):
    """A row (p,) k times below itself (k, p), by k; numpy takes long to stretch a row itself."""

    def __init__(self, row: Array) -> None:
        super().__init__()
        self._row = row

    def __missing__(self, k: int) -> Array:
        """Return the row ``k`` times, remembered for the next call."""
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
