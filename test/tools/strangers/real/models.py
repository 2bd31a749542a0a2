# SPDX-License-Identifier: Apache-2.0
"""The model of the pendulum, which belongs to its parameter file."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Space

_GRAVITY = 9.81


class Pendulum(Model):
    """J q'' = torque - m c g sin q - Fv q' - Fc atan(100 q') - offset, by those who recorded it.

    The torque is a state that wanders: its reading is rough, and would make the motion random if
    it were taken for the torque.
    """

    state = Space(('q', 'v', 'torque'), ('rad', 'rad/s', 'N m'))
    input = Space((), ())
    max_step = 0.02

    def __init__(
        self,
        inertia: Annotated[float, About('J', 'kg m^2', minimum=1e-4)] = 0.06259,
        weight: Annotated[float, About('mass by its lever', 'kg m')] = 0.1022,
        viscous: Annotated[float, About('Fv', 'N m s')] = 0.04707,
        dry: Annotated[float, About('Fc', 'N m')] = 0.1839,
        offset: Annotated[float, About('of the torque', 'N m')] = -0.07586,
        drift: Annotated[float, About('of the torque', 'N^2 m^2/s', minimum=0.0)] = 1000.0,
        torque_noise: Annotated[float, About('random torque', 'N^2 m^2 s', minimum=0.0)] = 0.3,
    ) -> None:
        self._inertia, self._pull = inertia, weight * _GRAVITY
        self._friction = viscous, dry, offset
        self._noise = np.diag([0.0, torque_noise / inertia**2, drift])

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the change of angle, speed and torque."""
        q, v, torque = (x[..., k] for k in range(3))
        viscous, dry, offset = self._friction
        resisted = self._pull * np.sin(q) + viscous * v + dry * np.arctan(100.0 * v) + offset
        return np.stack((v, (torque - resisted) / self._inertia, np.zeros_like(q)), axis=-1)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the random torque and of the drift."""
        return self._noise
