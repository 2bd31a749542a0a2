# SPDX-License-Identifier: Apache-2.0
"""Expected averages along a stationary recursion, and their scatter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.control.separation import Expectation
from kalman_ros.core import Array, Transition
from kalman_ros.linear.lyapunov import stationary_covariance

from . import mean_square

#: Probability that a correct system leaves the bounds of one check.
MISS = 1e-5
#: The same probability as a distance, in standard deviations of a normal variable.
SIGMAS = 4.4


@dataclass(frozen=True)
class Stationary:
    """z' = M z + n with n ~ N(0, N): M, N (n, n)."""

    matrix: Array
    noise: Array

    @cached_property
    def covariance(self) -> Array:
        """The covariance of z (n, n), by the Lyapunov equation."""
        return stationary_covariance(self.matrix, self.noise, sampled=True)

    def average(self, weight: Array, steps: int) -> Expectation:
        """Return the expected average of z'W z over ``steps`` steps.

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
        """Compare the RMS of recorded ``values`` (N,) with the RMS of z[index]."""
        weight = np.zeros_like(self.matrix)
        weight[index, index] = 1.0
        expected, square = self.average(weight, len(values)), float(np.mean(values**2))
        return mean_square(name, unit, expected, square, MISS, root=True)


def estimation_error(step: Transition, C: Array, R: Array, gain: Array) -> Stationary:
    """Return the error x - x_hat after a reading: e' = (I - L C)(F e + w) - L v, for any L."""
    I_LC = np.eye(len(step.F)) - gain @ C
    return Stationary(I_LC @ step.F, I_LC @ step.Q @ I_LC.T + gain @ R @ gain.T)


def white(covariance: Array) -> Stationary:
    """Return a recursion without memory: z' = n."""
    return Stationary(np.zeros_like(covariance), covariance)
