# SPDX-License-Identifier: Apache-2.0
"""The Gaussian sum filter: a bank of extended Kalman filters, one for each hypothesis.

D. Alspach and H. Sorenson, Nonlinear Bayesian Estimation Using Gaussian Sum Approximations, IEEE
Trans. Automatic Control 17(4), 1972. With bearings its hypotheses are ranges: the bank of Peach
(1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from kalman_ros.core import About, Array, Gaussian, Sensor, Space, symmetric

from .correction import Correction
from .ekf import ExtendedKalmanFilter
from .filter import Plan

#: A hypothesis with a smaller weight is given up.
_LEAST_WEIGHT = 1e-4


class Mixture(Gaussian):
    """A weighted sum of Gaussians, which is to all others the Gaussian of its two moments.

    Parameters
    ----------
    weights
        Of the parts (k,), with the sum 1.
    parts
        The Gaussians.
    space
        Of the state.
    """

    weights: Array
    parts: Sequence[Gaussian]

    def __new__(cls, weights: Array, parts: Sequence[Gaussian], space: Space) -> Mixture:
        """Return the mixture with its moments."""
        points = np.array([part.mean for part in parts])
        mean = space.mean(points, weights)
        d = space.subtract(points, mean)
        within = np.tensordot(weights, [part.covariance for part in parts], axes=1)
        P = symmetric(within + (weights * d.T) @ d)
        self = super().__new__(cls, mean, P)
        self.weights, self.parts = weights, parts
        return self

    def _replace(self, **changes: Any) -> Gaussian:  # type: ignore[override]
        """Return one Gaussian: whoever changes the moments leaves nothing of the parts."""
        return Gaussian(*self)._replace(**changes)


@dataclass(frozen=True)
class GaussianSumFilter:
    """Extended Kalman filters side by side, weighted by how well they foresaw the readings.

    It is one of them until a sensor says that its reading may mean several things.

    Parameters
    ----------
    ekf
        What each hypothesis is filtered by.
    hypotheses
        How many there are at first.
    """

    ekf: ExtendedKalmanFilter
    hypotheses: int

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Predict each part; the weights stay."""
        if not isinstance(belief, Mixture):
            return self.ekf.predict(belief, u, dt)
        parts = [self.ekf.predict(part, u, dt) for part in belief.parts]
        return Mixture(belief.weights, parts, self._space)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Correct each part; its weight is multiplied by the likelihood of the reading."""
        if not isinstance(belief, Mixture):
            return self._first(belief, y, sensor)
        corrections = [self.ekf.correct(part, y, sensor) for part in belief.parts]
        with np.errstate(divide='ignore'):
            log = np.log(belief.weights) + [_log_likelihood(each) for each in corrections]
        innovation, S = self._expected(belief.weights, corrections, y, sensor)
        posterior = self._mixture(np.exp(log - log.max()), [c.posterior for c in corrections])
        return Correction(posterior, innovation, S)

    @property
    def _space(self) -> Space:
        return self.ekf.model.state

    def _first(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Correct a belief that is one Gaussian still."""
        correction = self.ekf.correct(belief, y, sensor)
        found = sensor.hypotheses(belief, y, self.hypotheses)
        if not found:
            return correction
        weights, parts = zip(*found)
        mixture = self._mixture(np.array(weights), parts)
        return Correction(mixture, correction.innovation, correction.innovation_covariance)

    def _mixture(self, weights: Array, parts: Sequence[Gaussian]) -> Mixture:
        """Return the parts that are likely enough, with weights of sum 1.

        Raises
        ------
        numpy.linalg.LinAlgError
            If none is, for what they foresaw is not finite.
        """
        if not weights.sum() > 0.0:
            raise np.linalg.LinAlgError('no hypothesis is left')
        kept = np.flatnonzero(weights >= _LEAST_WEIGHT * weights.sum())
        weights = weights[kept]
        return Mixture(weights / weights.sum(), [parts[k] for k in kept.tolist()], self._space)

    @staticmethod
    def _expected(
        weights: Array, corrections: Sequence[Correction], y: Array, sensor: Sensor
    ) -> tuple[Array, Array]:
        """Return the innovation of all parts together, and its expected covariance."""
        output = sensor.output
        points = output.subtract(y, np.array([each.innovation for each in corrections]))
        predicted = output.mean(points, weights)
        d = output.subtract(points, predicted)
        within = np.tensordot(weights, [c.innovation_covariance for c in corrections], axes=1)
        return output.subtract(y, predicted), symmetric(within + (weights * d.T) @ d)


def _log_likelihood(correction: Correction) -> float:
    """Return log N(innovation; 0, S), but for a constant."""
    _, log_determinant = np.linalg.slogdet(correction.innovation_covariance)
    return -0.5 * (correction.nis + float(log_determinant))


def build(
    plan: Plan,
    hypotheses: Annotated[
        int, About('hypotheses of a first reading that may mean many things', minimum=1)
    ] = 8,
) -> GaussianSumFilter:
    """Return the Gaussian sum filter of any model."""
    return GaussianSumFilter(ExtendedKalmanFilter(plan.model), hypotheses)
