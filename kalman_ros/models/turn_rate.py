# SPDX-License-Identifier: Apache-2.0
"""A target in the plane with nearly constant speed and turn rate (CTRV)."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Space, coordinates, from_coordinates
from kalman_ros.linear.views import entries_last


class TurnRate(Model):
    """x' = v cos psi, y' = v sin psi, psi' = omega, with noise on v' and omega'.

    R. Schubert, E. Richter and G. Wanielik, Comparison and Evaluation of Advanced Motion Models
    for Vehicle Tracking, FUSION 2008, section II.
    """

    state = Space(
        ('x', 'y', 'v', 'psi', 'omega'), ('m', 'm', 'm/s', 'rad', 'rad/s'), angles=('psi',)
    )
    input = Space((), ())
    max_step = 0.05

    def __init__(
        self,
        acceleration_noise: Annotated[
            float, About('spectral density of the acceleration', 'm^2/s^3', minimum=0.0)
        ] = 0.05,
        turn_noise: Annotated[
            float, About('spectral density of the change of turn rate', 'rad^2/s^3', minimum=0.0)
        ] = 0.02,
    ) -> None:
        self._noise = np.diag([0.0, 0.0, acceleration_noise, 0.0, turn_noise])

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity, and no change of speed and turn rate."""
        _, _, v, psi, omega = coordinates(x)
        still = np.zeros_like(v)
        return from_coordinates(v * np.cos(psi), v * np.sin(psi), still, omega, still)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of the velocity by speed and heading, and of heading by omega."""
        v, psi = x[..., 2], x[..., 3]
        A = np.zeros((5, 5, *v.shape))
        A[:2, 2] = np.cos(psi), np.sin(psi)
        A[:2, 3] = -v * np.sin(psi), v * np.cos(psi)
        A[3, 4] = 1.0
        return entries_last(A)

    def noise_density(self, x: Array) -> Array:
        """Return the noise of acceleration and turn rate."""
        return self._noise


MODEL = TurnRate
