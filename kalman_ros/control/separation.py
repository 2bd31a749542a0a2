# SPDX-License-Identifier: Apache-2.0
"""The LQG loop as theory sees it: regulator and estimator, designed apart, put together.

The state x and the estimation error e of a sampled loop with u = -K x_hat obey

    x' = (F - G K) x + G K e + w
    e' = (I - L C) (F e + w) - L v

so the error does not know the regulator, and the poles of the loop are those of F - G K and of
the error. Sensors may have different rates: C, L and the covariance of v then repeat with a
period of some steps, and so do all statistics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from kalman_ros.core import Array, DesignError, Transition, solve, symmetric

from .lqr import Cost
from .structure import ComplexArray, eigenvalues

#: So many periods without convergence mean that the error covariance grows without bound.
_MOST_PERIODS = 100_000
_UNBOUNDED = 1e100


@dataclass(frozen=True)
class Readings:
    """What is read at one step: the stacked C (k, n) and the covariance R (k, k); k may be 0."""

    C: Array
    R: Array


@dataclass(frozen=True)
class Expectation:
    """The mean of an average along a run, and the standard deviation that it has over runs."""

    mean: float
    std: float


@dataclass(frozen=True)
class LqgLoop:
    """The statistics of a Kalman filter and a state feedback in one loop, in steady state.

    Parameters
    ----------
    step
        One sample of the plant.
    schedule
        What is read at each step of a period.
    gain
        K (m, n).
    """

    step: Transition
    schedule: Sequence[Readings]
    gain: Array

    @cached_property
    def _filter(self) -> tuple[Array, Array, list[Array]]:
        """Covariances before and after the readings (p, n, n), and gains, of each phase."""
        F, Q = self.step.F, self.step.Q
        eye = np.eye(len(F))
        after = eye * max(1.0, float(np.trace(Q)))
        p = len(self.schedule)
        prior, posterior = np.zeros((p, *F.shape)), np.zeros((p, *F.shape))
        gains: list[Array] = [np.zeros((len(F), len(readings.C))) for readings in self.schedule]
        for _ in range(_MOST_PERIODS):
            start = after
            for phase, readings in enumerate(self.schedule):
                C, R = readings.C, readings.R
                P = symmetric(F @ after @ F.T + Q)
                L = solve(C @ P @ C.T + R, C @ P).T
                I_LC = eye - L @ C
                after = symmetric(I_LC @ P @ I_LC.T + L @ R @ L.T)
                prior[phase], posterior[phase], gains[phase] = P, after, L
            if np.allclose(after, start, rtol=1e-12, atol=0.0):
                return prior, posterior, gains
            if np.trace(after) > _UNBOUNDED:
                break
        raise DesignError('the error covariance has no steady state with these sensors')

    @property
    def posterior(self) -> Array:
        """The error covariance after the readings of each phase (p, n, n)."""
        return self._filter[1]

    @property
    def regulator_poles(self) -> ComplexArray:
        """Eigenvalues of F - G K (n,)."""
        return eigenvalues(self.step.F - self.step.G @ self.gain)

    @property
    def regulator_matrix(self) -> Array:
        """[F - G K, G K] (n, 2n), which takes (x, e) to the next x."""
        return np.asarray(self._transitions[0, : len(self.step.F)])

    @property
    def error_matrix(self) -> Array:
        """The matrix (n, n) that takes the error over one period, to the last of its phases."""
        n = len(self.step.F)
        over = np.eye(n)
        for transition in self._transitions:
            over = transition[n:, n:] @ over
        return over

    @property
    def error_noise(self) -> Array:
        """The covariance (n, n) that one period of noise adds to the error."""
        P, M = self.posterior[-1], self.error_matrix
        return symmetric(P - M @ P @ M.T)

    @property
    def estimator_poles(self) -> ComplexArray:
        """Eigenvalues of the error over one step (n,); with a period, their p-th roots."""
        return np.asarray(eigenvalues(self.error_matrix) ** (1.0 / len(self.schedule)))

    @cached_property
    def _transitions(self) -> Array:
        """Of each phase, the matrix (2n, 2n) that takes (x, e) into it."""
        F, G, K = self.step.F, self.step.G, self.gain
        n = len(F)
        result = np.zeros((len(self.schedule), 2 * n, 2 * n))
        for phase, (readings, L) in enumerate(zip(self.schedule, self._filter[2])):
            result[phase, :n, :n] = F - G @ K
            result[phase, :n, n:] = G @ K
            result[phase, n:, n:] = (np.eye(n) - L @ readings.C) @ F
        return result

    @cached_property
    def _noises(self) -> Array:
        """Of each phase, the covariance (2n, 2n) that the noises of its step add to (x, e)."""
        n = len(self.step.F)
        result = np.zeros((len(self.schedule), 2 * n, 2 * n))
        for phase, (readings, L) in enumerate(zip(self.schedule, self._filter[2])):
            through = np.vstack((np.eye(n), np.eye(n) - L @ readings.C))
            result[phase] = through @ self.step.Q @ through.T
            result[phase, n:, n:] += L @ readings.R @ L.T
        return result

    @cached_property
    def covariance(self) -> Array:
        """The covariance of (x, e) after the readings of each phase (p, 2n, 2n)."""
        transitions, noises = self._transitions, self._noises
        over, added = np.eye(len(noises[0])), np.zeros_like(noises[0])
        for A, N in zip(transitions, noises):
            over, added = A @ over, A @ added @ A.T + N
        current = solve_discrete_lyapunov(over, added)
        result = np.zeros_like(noises)
        for phase, (A, N) in enumerate(zip(transitions, noises)):
            current = symmetric(A @ current @ A.T + N)
            result[phase] = current
        return result

    def average(self, weights: Array, steps: int) -> list[Expectation]:
        """Return what to expect of averages of quadratic forms over ``steps`` steady steps.

        Parameters
        ----------
        weights
            Symmetric M (s, p, 2n, 2n): the s averages are those of z'M[s, phase] z, z = (x, e).
        steps
            The number of steps averaged over.

        Notes
        -----
        For a Gaussian sequence cov(z'M z, y'N y) = 2 tr(M C N C') with C = cov(z, y) (Magnus
        and Neudecker, Matrix Differential Calculus, section 12.13); the variance of an average
        is the sum of those over all pairs of steps.
        """
        sigma = self.covariance
        p = len(self.schedule)
        means = np.einsum('spij,pji->s', weights, sigma) / p
        lagged = sigma  # cov(z at phase + lag, z at phase), by phase
        # tr(M_k C M_l C') with M_l at the phase and M_k at the phase + lag
        total = np.zeros(len(weights))
        for lag in range(steps):
            shifted = np.roll(weights, -lag, axis=1)
            terms = np.einsum('spij,pjk,spkl,pil->s', shifted, lagged, weights, lagged,
                              optimize=True)  # fmt: skip
            share = 1.0 if lag == 0 else 2.0 * (1.0 - lag / steps)
            total += share * terms / p
            if np.abs(lagged).max() < 1e-6 * np.abs(sigma).max():
                break
            lagged = np.roll(self._transitions, -lag - 1, axis=0) @ lagged
        variances = 2.0 * total / steps
        return [
            Expectation(float(mean), float(np.sqrt(variance)))
            for mean, variance in zip(means, variances)
        ]

    def error_weight(self, index: int) -> Array:
        """Return the M of e_i squared (p, 2n, 2n), for `average`."""
        n = len(self.step.F)
        M = np.zeros((len(self.schedule), 2 * n, 2 * n))
        M[:, n + index, n + index] = 1.0
        return M

    @property
    def nees_weight(self) -> Array:
        """The M of e'P^-1 e (p, 2n, 2n), for `average`."""
        n = len(self.step.F)
        M = np.zeros((len(self.schedule), 2 * n, 2 * n))
        M[:, n:, n:] = symmetric(np.asarray(np.linalg.inv(self.posterior), dtype=float))
        return M

    def cost_weight(self, cost: Cost) -> Array:
        """Return the M of a sample's cost (p, 2n, 2n), for `average`; u = -K (x - e)."""
        n, K = len(self.step.F), self.gain
        stacked = np.block([[np.eye(n), np.zeros((n, n))], [-K, K]])
        return np.tile(stacked.T @ cost.weight @ stacked, (len(self.schedule), 1, 1))


def optimal_cost(step: Transition, gain: Array, S: Array, cost: Cost, errors: Array) -> float:
    """Return the expected cost of a sample: tr(S Q) + tr(K'(R + G'S G) K P).

    ``errors`` (p, n, n) are the error covariances of the estimate that is fed back, averaged
    over the period (Anderson and Moore, 1990, section 8.2, in sampled time). The first term is
    what the process noise costs when the state is known; the second is the price of not knowing
    it.
    """
    G, K = step.G, gain
    price = K.T @ (cost.input + G.T @ S @ G) @ K
    return float(np.trace(S @ step.Q) + np.trace(price @ errors.mean(axis=0)))
