# SPDX-License-Identifier: Apache-2.0
"""The LQG loop in theory: regulator and estimator, designed separately, in one loop.

The state x and the estimation error e of a sampled loop with u = -K x_hat obey

    x' = (F - G K) x + G K e + w
    e' = (I - L C) (F e + w) - L v

so the error is independent of the regulator, and the poles of the loop are those of F - G K and of
the error. A regulator may have a state q, an integral for example, which is known.
Sensors may have different rates: C, L and the covariance of v then repeat with a period of several
steps, and so do all statistics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kalman_ros.core import Array, Transition, symmetric
from kalman_ros.linear.lyapunov import stationary_covariance
from kalman_ros.linear.periodic import PeriodicFilter, Phase, Readings, periodic_filter
from kalman_ros.linear.structure import ComplexArray, eigenvalues

from .lqr import Cost
from .state_space import StateSpace

#: An eigenvalue of a correlation this small is zero except for rounding.
_KNOWN = 1e-15


@dataclass(frozen=True)
class Expectation:
    """The mean of an average over a run, and its standard deviation over runs."""

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
        The readings at each step of a period.
    regulator
        From the state x_hat (n) to -u (m), sampled: a gain K as a `static` system, or one with
        a state q (r).
    """

    step: Transition
    schedule: Sequence[Readings]
    regulator: StateSpace

    @property
    def size(self) -> int:
        """The length n + r of (x, q)."""
        return len(self.step.F) + len(self.regulator.A)

    @cached_property
    def answer(self) -> Array:
        """The matrix (m, n + r + n) from (x, q, e) to u."""
        K = self.regulator.D
        return np.hstack((-K, -self.regulator.C, K))

    @cached_property
    def _filter(self) -> PeriodicFilter:
        F, Q = self.step.F, self.step.Q
        return periodic_filter([Phase(F, Q, readings) for readings in self.schedule])

    @property
    def posterior(self) -> Array:
        """The error covariance after the readings of each phase (p, n, n)."""
        return self._filter.posterior

    @property
    def estimator_gains(self) -> list[Array]:
        """L (n, k) of each phase: x_hat += L (y - C x_hat)."""
        return self._filter.gains

    @property
    def regulator_poles(self) -> ComplexArray:
        """Eigenvalues of the plant with its regulator (n + r,)."""
        return eigenvalues(self.closed_matrix)

    @property
    def closed_matrix(self) -> Array:
        """The matrix from (x, q) to the next one when the state is known: F - G K."""
        return np.asarray(self.regulator_matrix[:, : self.size])

    @property
    def regulator_matrix(self) -> Array:
        """The matrix from (x, q, e) to the next (x, q): [F - G K, G K] without a q."""
        F, n = self.step.F, len(self.step.F)
        A, B = self.regulator.A, self.regulator.B
        driven = np.vstack((self.step.G @ self.answer, np.zeros((len(A), self.size + n))))
        return np.asarray(driven + np.block([[F, np.zeros((n, len(A) + n))], [B, A, -B]]))

    @property
    def error_matrix(self) -> Array:
        """The matrix (n, n) of the error over one period, to the last phase."""
        over = np.eye(len(self.step.F))
        for transition in self._transitions:
            over = transition[self.size :, self.size :] @ over
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
        """The matrix of (x, q, e) into each phase."""
        F, n, r = self.step.F, len(self.step.F), self.size
        result = np.zeros((len(self.schedule), r + n, r + n))
        for phase, (readings, L) in enumerate(zip(self.schedule, self._filter.gains)):
            result[phase, :r] = self.regulator_matrix
            result[phase, r:, r:] = (np.eye(n) - L @ readings.C) @ F
        return result

    @cached_property
    def _noises(self) -> Array:
        """The covariance that the noises of a step add to (x, q, e), by phase."""
        n, r = len(self.step.F), self.size
        result = np.zeros((len(self.schedule), r + n, r + n))
        for phase, (readings, L) in enumerate(zip(self.schedule, self._filter.gains)):
            through = np.vstack((np.eye(r, n), np.eye(n) - L @ readings.C))
            result[phase] = through @ self.step.Q @ through.T
            result[phase, r:, r:] += L @ readings.R @ L.T
        return result

    @cached_property
    def covariance(self) -> Array:
        """The covariance of (x, q, e) after the readings of each phase."""
        transitions, noises = self._transitions, self._noises
        over, added = np.eye(len(noises[0])), np.zeros_like(noises[0])
        for A, N in zip(transitions, noises):
            over, added = A @ over, A @ added @ A.T + N
        current = stationary_covariance(over, added, sampled=True)
        result = np.zeros_like(noises)
        for phase, (A, N) in enumerate(zip(transitions, noises)):
            current = symmetric(A @ current @ A.T + N)
            result[phase] = current
        return result

    def average(self, weights: Array, steps: int) -> list[Expectation]:
        """Return the expected averages of quadratic forms over ``steps`` steady steps.

        Parameters
        ----------
        weights
            Symmetric M (s, p, :, :): the s averages are those of z'M[s, phase] z, with
            z = (x, q, e).
        steps
            The number of steps averaged over, the first at the first phase of a period.

        Notes
        -----
        For a Gaussian sequence cov(z'M z, y'N y) = 2 tr(M C N C') with C = cov(z, y) (Magnus
        and Neudecker, Matrix Differential Calculus, section 12.13); the variance of an average
        is the sum of those over all pairs of steps.
        """
        sigma = self.covariance
        p = len(self.schedule)
        means = np.einsum('spij,pji->sp', weights, sigma) @ _count(steps, p) / steps
        lagged = sigma  # cov(z at phase + lag, z at phase), by phase
        # tr(M_k C M_l C') with M_l at the phase and M_k at the phase + lag
        total = np.zeros(len(weights))
        for lag in range(steps):
            shifted = np.roll(weights, -lag, axis=1)
            terms = np.einsum('spij,pjk,spkl,pil->sp', shifted, lagged, weights, lagged,
                              optimize=True)  # fmt: skip
            pairs = _count(steps - lag, p)
            total += (1.0 if lag == 0 else 2.0) * terms @ pairs
            if np.abs(lagged).max() < 1e-6 * np.abs(sigma).max():
                break
            lagged = np.roll(self._transitions, -lag - 1, axis=0) @ lagged
        variances = 2.0 * total / steps**2
        return [
            Expectation(float(mean), float(np.sqrt(variance)))
            for mean, variance in zip(means, variances)
        ]

    def state_weight(self, index: int) -> Array:
        """Return the M of x_i squared, for `average`."""
        return self._square(index)

    def error_weight(self, index: int) -> Array:
        """Return the M of e_i squared, for `average`."""
        return self._square(self.size + index)

    def _square(self, index: int) -> Array:
        M = self._zero_weight()
        M[:, index, index] = 1.0
        return M

    @property
    def nees_weight(self) -> Array:
        """The M of e'P^-1 e, for `average`."""
        M, r = self._zero_weight(), self.size
        # an exactly known coordinate has no error to normalise; the pseudo-inverse omits it
        std = np.sqrt(self.posterior.diagonal(axis1=1, axis2=2))
        unit = np.divide(1.0, std, out=np.zeros_like(std), where=std > 0.0)
        units = unit[:, :, np.newaxis] * unit[:, np.newaxis, :]
        inverse = np.linalg.pinv(self.posterior * units, rcond=_KNOWN, hermitian=True)
        M[:, r:, r:] = symmetric(np.asarray(inverse * units, dtype=float))
        return M

    def _zero_weight(self) -> Array:
        size = self.size + len(self.step.F)
        return np.zeros((len(self.schedule), size, size))

    def cost_weight(self, cost: Cost) -> Array:
        """Return the M of a sample's cost, for `average`."""
        state = np.eye(len(self.step.F), self.answer.shape[1])
        stacked = np.vstack((state, self.answer))
        return np.tile(stacked.T @ cost.weight @ stacked, (len(self.schedule), 1, 1))

    def mean_cost(self, cost: Cost) -> float:
        """Return the mean cost of a sample; for the optimal regulator `optimal_cost`."""
        period = len(self.schedule)
        return self.average(self.cost_weight(cost)[np.newaxis], period)[0].mean


def _count(steps: int, period: int) -> Array:
    """Return the number of the first ``steps`` steps at each phase of a period (p,)."""
    return np.asarray((steps - np.arange(period) + period - 1) // period, dtype=float)


def optimal_cost(step: Transition, gain: Array, S: Array, cost: Cost, errors: Array) -> float:
    """Return the expected cost of a sample: tr(S Q) + tr(K'(R + G'S G) K P).

    ``errors`` (p, n, n) are the error covariances of the estimate that is fed back, averaged
    over the period (Anderson and Moore, 1990, section 8.2, in sampled time). The first term is
    the cost of process noise with a known state; the second is the cost of estimation.
    """
    G, K = step.G, gain
    price = K.T @ (cost.input + G.T @ S @ G) @ K
    return float(np.trace(S @ step.Q) + np.trace(price @ errors.mean(axis=0)))
