# SPDX-License-Identifier: Apache-2.0
"""Correction of beliefs by readings of earlier states."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Model, Sensor, unchecked
from kalman_ros.estimators.filter import Correction, Filter

#: Duration in seconds so short that the noise covariance is its density times the duration.
_SHORT = 1e-6
#: Duration in seconds so short that its noise is smaller than the covariance of any belief.
SAFE = 1e-4


class Earlier(Sensor):
    """A candidate sensor that reads the state a short time d earlier, x minus d dx/dt.

    Rotations are turned back.

    Parameters
    ----------
    sensor
        Sensor for states (..., p, n).
    model
        Model of the p candidates.
    """

    def __init__(self, sensor: Sensor, model: Model) -> None:
        self.output, self.covariance, self.name = sensor.output, sensor.covariance, sensor.name
        self.state = model.state
        self._sensor, self._model = sensor, model
        # shared by copies with another covariance
        self._now: dict[str, Any] = {}

    def set(self, earlier: Array, input: Array) -> None:
        """Set how much earlier the next reading is, in seconds (p,), and its input (m,)."""
        self._now.update(earlier=earlier[:, np.newaxis], input=input)

    def measure(self, x: Array) -> Array:
        """Return the readings (..., p, k) of the earlier states."""
        rate = self._model.derivative(x, self._now['input'])
        return self._sensor.measure(self.state.add(x, -self._now['earlier'] * rate))

    def noise_between(self, x: Array, longest: float) -> Array:
        """Return d W (p, n, n), the noise covariance between the earlier states and ``x`` (p, n).

        The duration d is limited to ``longest`` seconds.
        """
        W = self._model.noise_covariance(x, self._now['input'], _SHORT) / _SHORT
        return np.asarray(np.minimum(self._now['earlier'], longest)[..., np.newaxis] * W)


def noisier(sensor: Sensor, x: Array, noise: Array) -> Sensor:
    """Return a sensor that reads x - w, with w of covariance ``noise`` and independent of x.

    So it reads the states before an initial belief, which contains no noise since then.
    """
    H = sensor.jacobian(x)
    return sensor.with_covariance(sensor.covariance + H @ noise @ np.swapaxes(H, -1, -2))


def corrected(
    filter: Filter, prior: Gaussian, y: Array, sensor: Sensor, noise: Array
) -> Correction:
    """Correct beliefs (p, n) by readings of the states before ``noise`` (p, n, n) was added.

    Let x = z + w with noise w that is independent of z. A reading of z corrects x by the gain for
    P - cov(w), and cov(w) remains.
    """
    correction = filter.correct(unchecked((prior.mean, prior.covariance - noise)), y, sensor)
    x, P = correction.posterior
    return correction.with_posterior(unchecked((x, P + noise)))
