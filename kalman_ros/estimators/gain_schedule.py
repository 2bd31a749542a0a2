# SPDX-License-Identifier: Apache-2.0
"""The covariances and gains of a linear system, computed once since no reading changes them.

They equal the results of the filter for one belief, including its repairs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor
from kalman_ros.linear.batched import whitened

from .filter import Filter, LinearUpdate, committed
from .fixed_gain import FixedGainObserver

#: The cache is cleared beyond this many entries; a schedule that has converged repeats itself.
_MOST = 20_000


class ScheduledPrediction(NamedTuple):
    """A prediction x' = F x + G u, with the covariance (n, n) after it."""

    F: Array
    G: Array
    covariance: Array


class ScheduledCorrection(NamedTuple):
    """A correction: gain K (n, k), covariances S (k, k) and P (n, n), and L^-1 with L L' = S."""

    gain: Array
    innovation_covariance: Array
    covariance: Array
    whitening: Array


class GainSchedule:
    """Predictions and corrections of a linear system, by the prior covariance.

    Parameters
    ----------
    filter
        Filter of one belief.
    """

    def __init__(self, filter: Filter) -> None:
        self._filter, self._model = filter, filter.model
        #: Whether the filter, its model and its space are linear.
        self.applies = filter.model.is_linear and isinstance(
            filter, (LinearUpdate, FixedGainObserver)
        )
        self._known: dict[tuple[bytes, float], ScheduledPrediction | ScheduledCorrection] = {}
        self._sensors: dict[int, Sensor] = {}
        self._roots: dict[bytes, Array] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle a schedule without its cached results."""
        return GainSchedule, (self._filter,)

    def wrap(self, x: Array) -> Array:
        """Return states ``x`` (..., n) with every angle in [-pi, pi)."""
        return self._model.state.wrap(x)

    def prediction(self, P: Array, dt: float) -> ScheduledPrediction:
        """Return the prediction over ``dt`` seconds from a covariance ``P`` (n, n).

        Raises
        ------
        numpy.linalg.LinAlgError
            If the covariance cannot be predicted.
        """
        key = P.tobytes(), dt
        prediction = self._known.get(key)
        if not isinstance(prediction, ScheduledPrediction):
            step = self._model.sampled(dt)  # type: ignore[attr-defined]
            n, m = step.G.shape
            moved, _ = committed(self._filter.predict(Gaussian(np.zeros(n), P), np.zeros(m), dt))
            prediction = ScheduledPrediction(step.F, step.G, moved.covariance)
            self._keep(key, prediction)
        return prediction

    def correction(self, P: Array, sensor: Sensor) -> ScheduledCorrection | None:
        """Return the correction by a reading of ``sensor``; None if the sensor is not linear.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the innovation covariance is not positive definite.
        """
        if not sensor.linear:
            return None
        key = P.tobytes(), id(sensor)
        correction = self._known.get(key)
        if not isinstance(correction, ScheduledCorrection):
            correction = self._corrected(P, sensor)
            self._sensors[id(sensor)] = sensor  # kept alive, so that no other sensor gets its id
            self._keep(key, correction)
        return correction

    def whitening(self, P: Array) -> Array:
        """Return L^-1 (n, n) with L L' = P, which maps errors of covariance P to N(0, I)."""
        key = P.tobytes()
        if key not in self._roots:
            if len(self._roots) >= _MOST:
                self._roots.clear()
            self._roots[key] = _inverse_root(P)
        return self._roots[key]

    def _corrected(self, P: Array, sensor: Sensor) -> ScheduledCorrection:
        x = np.zeros(len(P))
        at_rest = self._filter.correct(Gaussian(x, P), sensor.measure(x), sensor)
        S, posterior = at_rest.innovation_covariance, committed(at_rest.posterior)[0]
        K = at_rest.gain
        assert K is not None
        return ScheduledCorrection(K, S, posterior.covariance, _inverse_root(S))

    def _keep(
        self, key: tuple[bytes, float], result: ScheduledPrediction | ScheduledCorrection
    ) -> None:
        if len(self._known) >= _MOST:
            self._known.clear()
        self._known[key] = result


def _inverse_root(P: Array) -> Array:
    L = np.asarray(np.linalg.cholesky(P), dtype=float)
    return np.asarray(whitened(L, np.eye(len(L))).T)
