# SPDX-License-Identifier: Apache-2.0
"""What to expect of averages along a stationary recursion, and how far they scatter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from kalman_ros.analysis.checks import Check
from kalman_ros.control.separation import Expectation
from kalman_ros.core import Array, Transition
from kalman_ros.estimators.consistency import chi_square_bounds

#: A right system leaves the bounds of one check with this probability.
MISS = 1e-5
#: The same as a distance, in standard deviations of a normal variable.
SIGMAS = 4.4


@dataclass(frozen=True)
class Stationary:
    """z' = M z + n with n ~ N(0, N): M, N (n, n)."""

    matrix: Array
    noise: Array

    @cached_property
    def covariance(self) -> Array:
        """The covariance of z (n, n), by the Lyapunov equation."""
        return np.asarray(solve_discrete_lyapunov(self.matrix, self.noise))

    def average(self, weight: Array, steps: int) -> Expectation:
        """Return what to expect of the average of z'W z over ``steps`` steps.

        Its variance is the sum over pairs of steps of cov(z'W z, y'W y) = 2 tr(W C W C'), where
        C = cov(z, y) is M^lag times the covariance.
        """
        lagged, variance = self.covariance, 0.0
        for lag in range(steps):
            share = (1.0 if lag == 0 else 2.0) * (1.0 - lag / steps)
            variance += share * 2.0 / steps * float(np.trace(weight @ lagged @ weight @ lagged.T))
            lagged = self.matrix @ lagged
        return Expectation(float(np.trace(weight @ self.covariance)), float(np.sqrt(variance)))

    def rms(self, name: str, unit: str, index: int, values: Array) -> Check:
        """Return the comparison of the RMS of recorded ``values`` (N,) with that of z[index]."""
        weight = np.zeros_like(self.matrix)
        weight[index, index] = 1.0
        expected = self.average(weight, len(values))
        low, high = chi_square_bounds(expected.mean, expected.std**2, MISS)
        measured = float(np.mean(values**2))
        mean, value, least, most = np.sqrt([expected.mean, measured, low, high]).tolist()
        return Check(name, unit, mean, value, least, most, low <= measured <= high)


def estimation_error(step: Transition, C: Array, R: Array, gain: Array) -> Stationary:
    """Return the error x - x_hat after a reading: e' = (I - L C)(F e + w) - L v, for any L."""
    I_LC = np.eye(len(step.F)) - gain @ C
    return Stationary(I_LC @ step.F, I_LC @ step.Q @ I_LC.T + gain @ R @ gain.T)


def white(covariance: Array) -> Stationary:
    """Return what does not remember: z' = n."""
    return Stationary(np.zeros_like(covariance), covariance)
