# SPDX-License-Identifier: Apache-2.0
"""Readings of states that are earlier than the beliefs which they correct."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Model, Sensor, unchecked
from kalman_ros.estimators.filter import Correction, Filter

#: A time in seconds in which noise adds its density times the time.
_SHORT = 1e-6
#: In seconds: the noise of this time is less than the covariance of any belief.
SAFE = 1e-4


class Earlier(Sensor):
    """A candidate sensor whose readings are of states that are a little earlier, x - d dx/dt.

    Parameters
    ----------
    sensor
        For states (..., p, n).
    model
        That of the p candidates.
    """

    def __init__(self, sensor: Sensor, model: Model) -> None:
        self.output, self.covariance, self.name = sensor.output, sensor.covariance, sensor.name
        self._sensor, self._model = sensor, model
        # copies with another covariance share it
        self._now: dict[str, Any] = {}

    def set(self, earlier: Array, input: Array) -> None:
        """Set by how many seconds the next reading is earlier (p,), and the input (m,) then."""
        self._now.update(earlier=earlier[:, np.newaxis], input=input)

    def measure(self, x: Array) -> Array:
        """Return the readings (..., p, k)."""
        rate = self._model.derivative(x, self._now['input'])
        return self._sensor.measure(x - self._now['earlier'] * rate)

    def noise_between(self, x: Array, longest: float) -> Array:
        """Return d W (p, n, n), what noise adds between the earlier states and ``x`` (p, n).

        At most that of ``longest`` seconds.
        """
        W = self._model.noise_covariance(x, self._now['input'], _SHORT) / _SHORT
        return np.asarray(np.minimum(self._now['earlier'], longest)[..., np.newaxis] * W)


def corrected(
    filter: Filter, prior: Gaussian, y: Array, sensor: Sensor, noise: Array
) -> Correction:
    """Return beliefs (p, n) corrected by readings of states before ``noise`` (p, n, n) was added.

    With x = z + w, where the noise w is not in z, a reading of z corrects x by the gain for
    P - cov(w), and cov(w) stays.
    """
    found = filter.correct(unchecked((prior.mean, prior.covariance - noise)), y, sensor)
    x, P = found.posterior
    return found.with_posterior(unchecked((x, P + noise)))
