# SPDX-License-Identifier: Apache-2.0
"""The likelihood of parameters, its gradient and its Fisher information, by batched filters.

By the prediction-error decomposition, with innovations v and their covariances S,

    log L = -1/2 sum of v' S^-1 v + log |2 pi S|,
    I_ij = sum of dv/di' S^-1 dv/dj + 1/2 tr(S^-1 dS/di S^-1 dS/dj)

(A. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 1989, section 3.4;
N. Gupta and R. Mehra, IEEE Trans. Automatic Control 19(6), 1974). All derivatives are central
differences of filters that run in one batch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import log, pi

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear.batched import factor, log_determinant, whitened

from .block import Block
from .candidate import Build, Candidate
from .free_parameter import STEP, FreeParameter
from .observations import Observations
from .walk import Conditions, Walk

#: Receives the share of a pass that is done.
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Expansion:
    """The log-likelihood at a point z (p,): its value, gradient and Fisher information.

    ``data`` is the log-likelihood alone; ``value`` includes the priors.
    """

    z: Array
    value: float
    data: float
    gradient: Array
    information: Array


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of parameters on a recording.

    Parameters
    ----------
    parameters
        Parameters to fit.
    build
        Function that returns the candidate for values of the parameters.
    observations, conditions
        Recording, and the conditions under which the estimator processes it.
    until
        Last stamp that counts, in nanoseconds; None for all stamps.
    """

    parameters: Sequence[FreeParameter]
    build: Build
    observations: Observations
    conditions: Conditions
    until: int | None = None

    def first(self, count: int) -> Likelihood:
        """Return that of the first readings, or of all if there are no more than twice these."""
        stamps = np.sort(
            np.concatenate([readings.stamp for readings in self.observations.readings.values()])
        )
        if self.until is not None:
            stamps = stamps[stamps <= self.until]
        return self if len(stamps) <= 2 * count else replace(self, until=int(stamps[count]))

    def candidate(self, z: Array) -> Candidate:
        """Return the candidate at a point z (p,)."""
        pairs = zip(self.parameters, z.tolist())
        return self.build({free.name: free.value(coordinate) for free, coordinate in pairs})

    @property
    def start(self) -> Array:
        """Start of the fit (p,)."""
        return np.array([free.scaled(free.start) for free in self.parameters])

    def values(self, points: Sequence[Array]) -> Array:
        """Return the log-likelihood with the priors at each point; -inf if it is undefined."""
        values = self._values([self._candidate_or_none(z) for z in points])
        return np.asarray(values + [self.prior(z)[0] for z in points])

    def _candidate_or_none(self, z: Array) -> Candidate | None:
        try:
            return self.candidate(z)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError):
            return None

    def _values(self, candidates: Sequence[Candidate | None]) -> Array:
        valid = [candidate for candidate in candidates if candidate is not None]
        values = np.full(len(candidates), -np.inf)
        if valid:
            rows = [row for row, candidate in enumerate(candidates) if candidate is not None]
            values[rows] = self._values_in_one_pass(valid)
        return values

    def _values_in_one_pass(self, candidates: Sequence[Candidate]) -> Array:
        total = np.zeros(len(candidates))
        try:
            with np.errstate(all='ignore'):
                for block in self.walk(candidates).blocks(self.until):
                    total += self.terms(block).sum(axis=0)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError):
            if len(candidates) == 1:
                return np.array([-np.inf])
            middle = len(candidates) // 2
            halves = candidates[:middle], candidates[middle:]
            return np.concatenate([self._values_in_one_pass(half) for half in halves])
        return np.where(np.isfinite(total), total, -np.inf)

    def walk(self, candidates: Sequence[Candidate], together: bool = False) -> Walk:
        """Return the filters of the candidates before the first reading."""
        return Walk(self.observations, self.conditions, candidates, together)

    def terms(self, block: Block) -> Array:
        """Return the term of each reading in the log-likelihood (N, p).

        A reading that a gate rejects is an outlier, uniformly distributed over the range of the
        readings. Otherwise noise so small that every reading is rejected would be the likeliest.
        """
        L = factor(block.covariance)
        z = whitened(L, block.innovation)
        k = block.innovation.shape[-1]
        inside = -0.5 * (np.sum(z * z, axis=-1) + log_determinant(L) + k * log(2.0 * pi))
        if block.accepted.all():
            return np.asarray(inside)
        values = self.observations.readings[block.sensor].value
        ranges = np.nanmax(values, axis=0) - np.nanmin(values, axis=0)
        outlier = -float(np.log(np.where(ranges > 0.0, ranges, 1.0)).sum())
        return np.where(block.accepted, inside, outlier)

    def expand(self, z: Array, progress: Progress | None = None) -> Expansion | None:
        """Return the expansion at z (p,); None if there is no likelihood."""
        return self.expand_all([z], progress)[0]

    def expand_all(
        self, points: Sequence[Array], progress: Progress | None = None
    ) -> list[Expansion | None]:
        """Return the expansion at each point z (p,); None if there is no likelihood.

        Points with the same delays share one pass, which costs little more than the pass of a
        single point. With gates, each point needs a separate pass, since the gates depend on it.
        """
        stencils = []
        try:
            for z in points:
                about = [z, *(z + s * STEP * e for e in np.eye(len(z)) for s in (1.0, -1.0))]
                stencils.append([self.candidate(point) for point in about])
            delays = [stencil[0].delays for stencil in stencils]
            gated = any((self.conditions.policy.gates or {}).values())
            if len(points) == 1 or (not gated and all(other == delays[0] for other in delays)):
                return self._expand_in_one_pass(points, stencils, progress)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError):
            if len(points) == 1:
                return [None]
        return [self.expand(z, progress) for z in points]

    def _expand_in_one_pass(
        self,
        points: Sequence[Array],
        stencils: Sequence[Sequence[Candidate]],
        progress: Progress | None,
    ) -> list[Expansion | None]:
        """Return the expansions at q points from the candidates at and about each of them."""
        q, p = len(points), len(points[0])
        total, information = np.zeros((q, 2 * p + 1)), np.zeros((q, p, p))
        with np.errstate(all='ignore'):
            walk = self.walk(
                [candidate for stencil in stencils for candidate in stencil], together=True
            )
            for block in walk.blocks(self.until, progress):
                total += self.terms(block).sum(axis=0).reshape(total.shape)
                for index, part in enumerate(block.split(q)):
                    information[index] += _information(part)
        return [self._expansion(*parts) for parts in zip(points, total, information)]

    def _expansion(self, z: Array, total: Array, information: Array) -> Expansion | None:
        if not np.isfinite(total).all() or not np.isfinite(information).all():
            return None
        gradient = (total[1::2] - total[2::2]) / (2.0 * STEP)
        value, slope, curvature = self.prior(z)
        return Expansion(
            z, total[0] + value, float(total[0]), gradient + slope, information + curvature
        )

    def prior(self, z: Array) -> tuple[float, Array, Array]:
        """Return the log-density of the priors at z (p,), its gradient and its information."""
        value, slope, curvature = 0.0, np.zeros(len(z)), np.zeros((len(z), len(z)))
        for index, free in enumerate(self.parameters):
            prior = free.prior_scaled
            if prior is not None:
                mean, std = prior
                deviation = (z[index] - mean) / std
                value -= 0.5 * deviation**2
                slope[index], curvature[index, index] = -deviation / std, std**-2
        return float(value), slope, curvature


def _information(block: Block) -> Array:
    """Return the information (p, p) of readings from candidates at z and on both sides of it."""
    use = block.accepted[:, 0]
    if not use.any():
        return np.zeros(())
    E, S = block.innovation[use], block.covariance[use]
    L = factor(S[:, 0])
    N, k, count = len(E), E.shape[2], (E.shape[1] - 1) // 2
    dE = block.output.subtract(E[:, 1::2], E[:, 2::2]) / (2.0 * STEP)
    dS = (S[:, 1::2] - S[:, 2::2]) / (2.0 * STEP)
    W = whitened(L[:, np.newaxis], dE)
    one = whitened(L[:, np.newaxis, np.newaxis], dS)  # rows are S' L^-T
    M = whitened(L[:, np.newaxis, np.newaxis], one.swapaxes(-1, -2))
    W = np.moveaxis(W, 1, 0).reshape(count, N * k)
    M = np.moveaxis(M, 1, 0).reshape(count, N * k * k)
    return np.asarray(W @ W.T + 0.5 * (M @ M.T))
