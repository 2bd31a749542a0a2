# SPDX-License-Identifier: Apache-2.0
"""The Gaussian sum filter: a bank of extended Kalman filters, one for each hypothesis.

D. Alspach and H. Sorenson, Nonlinear Bayesian Estimation Using Gaussian Sum Approximations, IEEE
Trans. Automatic Control 17(4), 1972. With bearings its hypotheses are ranges: the bank of Peach
(1995), in which a range that becomes too uncertain is divided again.
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
#: A mixture has at most N times as many parts as one reading may divide one of them into.
_MOST = 3
#: Into how many parts a belief is divided, unless that is chosen.
HYPOTHESES = 8


@dataclass(frozen=True)
class GaussianSumFilter(Filter):
    """Extended Kalman filters in parallel, weighted by the likelihood of the readings.

    It is one of them until a sensor finds it too wide for its reading, and divides it, or an angle
    or a rotation is too uncertain for one; each part is divided again where it has become too
    wide.

    Parameters
    ----------
    ekf
        The filter of each hypothesis.
    hypotheses
        Into how many parts one reading divides one belief at most.
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
        """How the state moves."""
        return self.ekf.model

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Predict each part; weights are unchanged."""
        if not isinstance(belief, Mixture):
            return self.ekf.predict(belief, u, dt)
        parts = [self.ekf.predict(part, u, dt) for part in belief.parts]
        return Mixture(belief.weights, parts, self._space)

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Correct or divide each part; weights are multiplied by the likelihood of the reading.

        The NIS of a mixture is that of `forecast_nis`.

        Raises
        ------
        numpy.linalg.LinAlgError
            If no part can have foreseen the reading, for what they foresaw is not finite.
        """
        if isinstance(belief, Mixture):
            before, weights = belief.parts, belief.weights
        else:
            before, weights = [belief], np.ones(1)
        before, weights = self._within_reach(before, weights)
        found = [self._corrected(part, y, sensor) for part in before]
        if len(found) == 1 and isinstance(found[0], Correction):
            return found[0]
        outcomes = [_outcome(each, y, sensor) for each in found]
        log = np.log(weights)
        log_weights = np.concatenate([a + each.log_weights for a, (each, _) in zip(log, outcomes)])
        posterior = self._mixture(log_weights, [p for each, _ in outcomes for p in each.parts])
        shares = np.concatenate([w * each.shares for w, (each, _) in zip(weights, outcomes)])
        points = np.concatenate([each.forecast for each, _ in outcomes])
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
        """Return the parts, with those divided of which a turn is too wide for one."""
        if not self._space.turns:
            return parts, weights
        shares = [turned_parts(part, self._space, self.hypotheses) for part in parts]
        if all(len(own) == 1 for own, _ in shares):
            return parts, weights
        divided = [part for _, own in shares for part in own]
        return divided, np.concatenate([w * own for w, (own, _) in zip(weights, shares)])

    def _corrected(self, part: Gaussian, y: Array, sensor: Sensor) -> Hypotheses | Correction:
        """Return what a reading divides a part into, else its correction."""
        divided = sensor.hypotheses(part, y, self.hypotheses)
        return self.ekf.correct(part, y, sensor) if divided is None else divided

    def _mixture(self, log_weights: Array, parts: list[Gaussian]) -> Gaussian:
        """Return the parts that are likely enough, few enough, with weights of sum 1."""
        weights = np.exp(log_weights - log_weights.max())
        if not weights.sum() > 0.0:
            raise np.linalg.LinAlgError('no hypothesis is left')
        kept = np.flatnonzero(weights >= _LEAST_WEIGHT * weights.sum())
        weights = weights[kept] / weights[kept].sum()
        return reduced(
            weights, [parts[k] for k in kept.tolist()], self._space, _MOST * self.hypotheses
        )


def _outcome(found: Hypotheses | Correction, y: Array, sensor: Sensor) -> tuple[Hypotheses, Array]:
    """Return a part's hypotheses, one if it was only corrected, and the scatter of its forecast.

    That is the covariance (q, k, k) of the reading about each point of the forecast.
    """
    if isinstance(found, Hypotheses):
        return found, np.broadcast_to(sensor.covariance, (len(found.shares), y.size, y.size))
    S = found.innovation_covariance
    log_likelihood = -0.5 * (found.nis + np.linalg.slogdet(2.0 * np.pi * S)[1])
    forecast = sensor.output.subtract(y, found.innovation)
    one = Hypotheses(
        np.array([log_likelihood]), [found.posterior], np.ones(1), forecast[np.newaxis]
    )
    return one, S[np.newaxis]


FILTER = GaussianSumFilter
