# SPDX-License-Identifier: Apache-2.0
"""Observers with gains that are designed once: x += L (y - C x), for any L.

The covariance is the error covariance with this gain, not with the optimal one:
P = (I - L C) P (I - L C)' + L R L' holds for every gain.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, DiscreteLinearSystem, Gaussian, LinearSystem, Sensor, unchecked
from kalman_ros.linear.kernels import kernels

from .filter import Correction, Filter


@dataclass(frozen=True)
class FixedGainObserver(Filter):
    """An observer of a linear system with one gain L (n, k) for each sensor, by name."""

    model: LinearSystem | DiscreteLinearSystem
    gains: Mapping[str, Array]
    needs_linear = True
    fixed_gain = True

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = F x + G u, P = F P F' + Q."""
        (x, P), k = belief, kernels(belief[0])
        F, G, Q = self.model.sampled(dt)
        return unchecked((k.affine(F, x, G, u), k.sandwich(F, P, Q)))

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading with the gain of its sensor."""
        (x, P), k = belief, kernels(belief[0])
        L, C, R = self.gain(sensor), sensor.jacobian(x), sensor.covariance
        innovation = sensor.output.subtract(y, sensor.measure(x))
        mean = self.model.state.wrap(k.corrected(x, L, innovation))
        posterior = unchecked((mean, k.joseph(L, C, P, R)))
        return Correction(posterior, innovation, k.sandwich(C, P, R), L, C)

    def joint_gain(self, sensors: Iterable[Sensor]) -> Array:
        """Return the gain (n, k) of all readings of some sensors that read one after the other.

        The error is (I - L_2 C_2) (I - L_1 C_1) e after two: the first gain becomes
        (I - L_2 C_2) L_1.
        """
        n = self.model.state.size
        joint = np.empty((n, 0))
        for sensor in sensors:
            L = self.gain(sensor)
            joint = np.hstack(((np.eye(n) - L @ sensor.jacobian(np.zeros(n))) @ joint, L))
        return joint

    def gain(self, sensor: Sensor) -> Array:
        """Return the gain L (n, k) of a sensor; raise ValueError if there is none."""
        try:
            return self.gains[sensor.name]
        except KeyError:
            known = ', '.join(self.gains)
            hint = '' if sensor.name else "; give it one: sensor.name = '...'"
            raise ValueError(
                f'sensor: expected a name among ({known}), for which there are gains, '
                f"got '{sensor.name}'{hint}"
            ) from None
