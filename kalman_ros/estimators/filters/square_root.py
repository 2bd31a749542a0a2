# SPDX-License-Identifier: Apache-2.0
"""The extended Kalman filter in square-root form, which propagates factors of covariances.

The factor L of P = L L' resolves a small variance beside a large one with twice as many digits as
P does, and L L' is never indefinite. Both steps are one orthogonal
transformation, in the array form of T. Kailath, A. Sayed and B. Hassibi, Linear Estimation (2000),
chapter 12.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor
from kalman_ros.estimators.filter import Correction, LinearUpdate, Prediction
from kalman_ros.estimators.plan import parts
from kalman_ros.linear.batched import product, semidefinite_factor, symmetric
from kalman_ros.linear.kernels import kernels


class FactoredGaussian(Gaussian):
    """A Gaussian with the factor of its covariance.

    Parameters
    ----------
    mean
        Mean (..., n).
    factor
        L (..., n, n) with L L' = P.
    """

    factor: Array

    def __new__(cls, mean: Array, factor: Array) -> FactoredGaussian:
        """Return the belief, with P = L L'."""
        P = symmetric(product(factor, factor.swapaxes(-1, -2)))
        self: FactoredGaussian = tuple.__new__(cls, (mean, P))
        self.factor = factor
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments that recreate the belief."""
        return FactoredGaussian, (self.mean, self.factor)

    def _replace(self, **changes: Any) -> Gaussian:  # type: ignore[override]
        """Return a belief without a factor, since another covariance has another factor."""
        return Gaussian(*self)._replace(**changes)


@dataclass(frozen=True)
class SquareRootFilter(LinearUpdate):
    """An extended Kalman filter that stays accurate where variances are far apart."""

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = step(x, u), and L with L L' = F P F' + Q."""
        return self.linearized(belief, u, dt).belief

    def linearized(self, belief: Gaussian, u: Array, dt: float) -> Prediction:
        """Return the prediction, with F <- F_k F and Q <- F_k Q F_k' + Q_k over its steps."""
        x, k, L = belief.mean, kernels(belief.mean), _factor(belief)
        F, Q = np.eye(x.shape[-1]), np.zeros((x.shape[-1],) * 2)
        count = parts(self.model, dt)
        for _ in range(count):
            x, F_k, Q_k = self.model.linearized_step(x, u, dt / count)
            L = _triangle(product(F_k, L), semidefinite_factor(Q_k))
            F, Q = product(F_k, F), k.sandwich(F_k, Q, Q_k)
        return Prediction(FactoredGaussian(x, L), F, Q)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return x + K innovation; [R^1/2, H L; 0, L] turns into [S^1/2, 0; K S^1/2, L]."""
        x, k, L = belief.mean, kernels(belief.mean), _factor(belief)
        innovation = sensor.output.subtract(y, sensor.measure(x))
        H, m = sensor.jacobian(x), y.shape[-1]
        HL = product(H, L)
        R, size = k.repaired_factor(sensor.covariance), m + L.shape[-1]
        before = np.zeros((*np.broadcast_shapes(*(A.shape[:-2] for A in (HL, R, L))), size, size))
        before[..., :m, :m] = R
        before[..., :m, m:], before[..., m:, m:] = HL, L
        after = _triangle(before)
        root, weighted, L = after[..., :m, :m], after[..., m:, :m], after[..., m:, m:]
        K = np.linalg.solve(root.swapaxes(-1, -2), weighted.swapaxes(-1, -2)).swapaxes(-1, -2)
        S = symmetric(product(root, root.swapaxes(-1, -2)))
        total, space = k.corrected(x, K, innovation), self.model.state
        posterior: Gaussian = FactoredGaussian(space.wrap(total), L)
        if space.rotations:  # the axes of the rotation errors turn
            posterior = Gaussian(*space.arrived(total, x, posterior.covariance))
        return Correction(posterior, innovation, S, K, H)


def _factor(belief: Gaussian) -> Array:
    """Return L with L L' = P."""
    if belief.factor is not None:
        return belief.factor
    factor: Array = kernels(belief.mean).repaired_factor(belief.covariance)
    return factor


def _triangle(*parts: Array) -> Array:
    """Return L (..., n, n), lower triangular, with L L' the sum of A A' of the parts A."""
    lead = np.broadcast_shapes(*(part.shape[:-2] for part in parts))
    rows = [np.broadcast_to(part, (*lead, *part.shape[-2:])) for part in parts]
    qr: Any = np.linalg.qr
    R: Array = qr(np.concatenate(rows, axis=-1).swapaxes(-1, -2), mode='r')
    return np.asarray(R.swapaxes(-1, -2))


FILTER = SquareRootFilter
