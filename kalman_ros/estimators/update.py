# SPDX-License-Identifier: Apache-2.0
"""The measurement update that the linear and the extended filter share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, Gaussian, Model, Sensor, unchecked
from kalman_ros.linear.kernels import corrected, gain, joseph

from .correction import Correction


@dataclass(frozen=True)
class LinearUpdate:
    """What filters have in common that linearise a sensor about the mean.

    Parameters
    ----------
    model
        How the state moves.
    """

    model: Model

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return x + K innovation, (I - K H) P (I - K H)' + K R K', with K = P H' S^-1."""
        x, P = belief
        H, R = np.asfortranarray(sensor.jacobian(x)), sensor.covariance.T
        innovation = sensor.output.subtract(y, sensor.measure(x))
        K, S = gain(P, H, R)
        mean = self.model.state.wrap(corrected(x, K, innovation))
        return Correction(unchecked((mean, joseph(K, H, P, R))), innovation, S)
