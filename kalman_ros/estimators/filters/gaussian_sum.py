# SPDX-License-Identifier: Apache-2.0
"""The Gaussian sum filter: a bank of extended Kalman filters, one per hypothesis.

D. Alspach and H. Sorenson, Nonlinear Bayesian Estimation Using Gaussian Sum Approximations, IEEE
Trans. Automatic Control 17(4), 1972. With bearings the hypotheses are ranges, as in the bank of
Peach (1995); a range that becomes too uncertain is divided again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Dynamics, Gaussian, Hypotheses, Sensor, Space
from kalman_ros.estimators.filter import Correction, Filter
from kalman_ros.estimators.mixture import Mixture, forecast_nis, pooled, reduced, turned_parts
from kalman_ros.estimators.plan import Plan

from .ekf import ExtendedKalmanFilter

#: Hypotheses with a smaller weight are dropped.
_LEAST_WEIGHT = 1e-4
#: Largest number of parts of a mixture, as a multiple of the parts of one division.
_MOST = 3
#: Default number of parts into which a belief is divided.
HYPOTHESES = 8


@dataclass(frozen=True)
class GaussianSumFilter(Filter):
    """Extended Kalman filters in parallel, weighted by the likelihood of the readings.

    The belief is a single Gaussian until it is too wide for a reading of a sensor, or until an
    angle or a rotation is too uncertain; then it is divided. A part that becomes too wide is
    divided again.

    Parameters
    ----------
    ekf
        Filter of each hypothesis.
    hypotheses
        Largest number of parts into which one reading divides a belief.
    """

    ekf: ExtendedKalmanFilter
    hypotheses: int
    optimal = False
    mixture = True

    @classmethod
    def build(
        cls,
        plan: Plan,
        hypotheses: Annotated[
            int,
            About('Gaussians into which a reading divides one that is too wide for it', minimum=1),
        ] = HYPOTHESES,
    ) -> GaussianSumFilter:
        """Return the Gaussian sum filter of any model."""
        return cls(ExtendedKalmanFilter(plan.model), hypotheses)

    @property
    def model(self) -> Dynamics:  # type: ignore[override]
        """The system model."""
        return self.ekf.model

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Predict each part; weights are unchanged."""
        if not isinstance(belief, Mixture):
            return self.ekf.predict(belief, u, dt)
        parts = [self.ekf.predict(part, u, dt) for part in belief.parts]
        return Mixture(belief.weights, parts, self._space)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Correct or divide each part; weights are multiplied by the likelihood of the reading.

        The NIS of a mixture is `forecast_nis`.

        Raises
        ------
        numpy.linalg.LinAlgError
            If no part explains the reading, since its likelihoods are not finite.
        """
        if isinstance(belief, Mixture):
            before, weights = belief.parts, belief.weights
        else:
            before, weights = [belief], np.ones(1)
        before, weights = self._within_reach(before, weights)
        results = [self._corrected(part, y, sensor) for part in before]
        if len(results) == 1 and isinstance(results[0], Correction):
            return results[0]
        outcomes = [_outcome(result, y, sensor) for result in results]
        log = np.log(weights)
        log_weights = np.concatenate([a + h.log_weights for a, (h, _) in zip(log, outcomes)])
        posterior = self._mixture(log_weights, [p for h, _ in outcomes for p in h.parts])
        shares = np.concatenate([w * h.shares for w, (h, _) in zip(weights, outcomes)])
        points = np.concatenate([h.forecast for h, _ in outcomes])
        S = np.concatenate([scatter for _, scatter in outcomes])
        predicted, total = pooled(sensor.output, shares, points, S)
        difference = sensor.output.subtract
        nis = forecast_nis(shares, difference(y, points), S)
        return Correction(posterior, difference(y, predicted), total, nis=nis)

    @property
    def _space(self) -> Space:
        return self.model.state

    def _within_reach(
        self, parts: Sequence[Gaussian], weights: Array
    ) -> tuple[Sequence[Gaussian], Array]:
        """Divide the parts in which a turn is too wide for a single Gaussian."""
        if not self._space.turns:
            return parts, weights
        divisions = [turned_parts(part, self._space, self.hypotheses) for part in parts]
        if all(len(weight) == 1 for weight, _ in divisions):
            return parts, weights
        divided = [part for _, pieces in divisions for part in pieces]
        return divided, np.concatenate([w * weight for w, (weight, _) in zip(weights, divisions)])

    def _corrected(self, part: Gaussian, y: Array, sensor: Sensor) -> Hypotheses | Correction:
        """Return the hypotheses into which a reading divides a part, else its correction."""
        divided = sensor.hypotheses(part, y, self.hypotheses)
        return self.ekf.correct(part, y, sensor) if divided is None else divided

    def _mixture(self, log_weights: Array, parts: list[Gaussian]) -> Gaussian:
        """Return the mixture of the likely parts, reduced in number, with weights of sum 1."""
        weights = np.exp(log_weights - log_weights.max())
        if not weights.sum() > 0.0:
            raise np.linalg.LinAlgError('no hypothesis is left')
        kept = np.flatnonzero(weights >= _LEAST_WEIGHT * weights.sum())
        weights = weights[kept] / weights[kept].sum()
        return reduced(
            weights, [parts[k] for k in kept.tolist()], self._space, _MOST * self.hypotheses
        )


def _outcome(
    result: Hypotheses | Correction, y: Array, sensor: Sensor
) -> tuple[Hypotheses, Array]:
    """Return the hypotheses of a part, one if it was only corrected, and the forecast covariances.

    These are the covariances (q, k, k) of the reading about each point of the forecast.
    """
    if isinstance(result, Hypotheses):
        return result, np.broadcast_to(sensor.covariance, (len(result.shares), y.size, y.size))
    S = result.innovation_covariance
    log_likelihood = -0.5 * (result.nis + np.linalg.slogdet(2.0 * np.pi * S)[1])
    forecast = sensor.output.subtract(y, result.innovation)
    one = Hypotheses(
        np.array([log_likelihood]), [result.posterior], np.ones(1), forecast[np.newaxis]
    )
    return one, S[np.newaxis]


FILTER = GaussianSumFilter
