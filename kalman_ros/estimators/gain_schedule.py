# SPDX-License-Identifier: Apache-2.0
"""The covariances and gains of a linear system, which no reading changes: computed once for all.

They are those of the filter for one belief, with its repairs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor
from kalman_ros.linear.batched import whitened

from .filter import Filter, LinearUpdate, committed
from .fixed_gain import FixedGainObserver

#: More steps than this are forgotten; a schedule that has converged repeats itself.
_MOST = 20_000


class ScheduledPrediction(NamedTuple):
    """A prediction: x' = F x + G u, and the covariance (n, n) after it."""

    F: Array
    G: Array
    covariance: Array


class ScheduledCorrection(NamedTuple):
    """A correction: the gain K (n, k), the covariances S (k, k) and P (n, n), and L^-1 of S."""

    gain: Array
    innovation_covariance: Array
    covariance: Array
    whitening: Array


class GainSchedule:
    """Predictions and corrections of a linear system, by the covariance before them.

    Parameters
    ----------
    filter
        The filter of one belief.
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
        """Send a schedule to another process without what it has computed."""
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
        found = self._known.get(key)
        if not isinstance(found, ScheduledPrediction):
            step = self._model.sampled(dt)  # type: ignore[attr-defined]
            n, m = step.G.shape
            moved, _ = committed(self._filter.predict(Gaussian(np.zeros(n), P), np.zeros(m), dt))
            found = ScheduledPrediction(step.F, step.G, moved.covariance)
            self._keep(key, found)
        return found

    def correction(self, P: Array, sensor: Sensor) -> ScheduledCorrection | None:
        """Return the correction by a reading of ``sensor``; None if that is not linear.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the innovation covariance is not positive definite.
        """
        if not sensor.linear:
            return None
        key = P.tobytes(), id(sensor)
        found = self._known.get(key)
        if not isinstance(found, ScheduledCorrection):
            found = self._corrected(P, sensor)
            self._sensors[id(sensor)] = sensor  # alive, so that no other one gets its id
            self._keep(key, found)
        return found

    def whitening(self, P: Array) -> Array:
        """Return L^-1 (n, n) with L L' = P, which makes errors of this covariance N(0, I)."""
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
        self, key: tuple[bytes, float], found: ScheduledPrediction | ScheduledCorrection
    ) -> None:
        if len(self._known) >= _MOST:
            self._known.clear()
        self._known[key] = found


def _inverse_root(P: Array) -> Array:
    L = np.asarray(np.linalg.cholesky(P), dtype=float)
    return np.asarray(whitened(L, np.eye(len(L))).T)
