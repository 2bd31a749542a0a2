# SPDX-License-Identifier: Apache-2.0
"""Models and a sensor that the owners of these robots have written for the package.

They belong to the parameter files; the simulators do not know them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances


class Pendulum(Model):
    """theta'' = -g / l sin(theta) - c theta' + tau / (m l^2)."""

    state = Space(('theta', 'omega'), ('rad', 'rad/s'))
    input = Space(('tau',), ('N m',))
    max_step = 0.02

    def __init__(
        self,
        length: Annotated[float, About('length', 'm', minimum=1e-3)] = 0.5,
        mass: Annotated[float, About('mass at the end', 'kg', minimum=1e-3)] = 1.0,
        damping: Annotated[float, About('decay of the speed', '1/s', minimum=0.0)] = 0.4,
    ) -> None:
        self._pull, self._gain, self._damping = 9.80665 / length, 1.0 / mass / length**2, damping

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the change of angle and speed."""
        pull = self._pull * np.sin(x[..., 0])
        turn = self._gain * u[..., 0] - pull - self._damping * x[..., 1]
        return np.stack((x[..., 1], turn), axis=-1)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral density of the random torque."""
        return np.diag([0.0, 0.05])


class Quadrotor(Model):
    """A quadrotor in a vertical plane, with thrust and moment as its input."""

    state = Space(('x', 'z', 'tilt', 'vx', 'vz', 'turn'), ('m', 'm', 'rad', 'm/s', 'm/s', 'rad/s'))
    input = Space(('thrust', 'moment'), ('N', 'N m'))
    max_step = 0.02

    def __init__(
        self,
        mass: Annotated[float, About('mass', 'kg', minimum=1e-3)] = 1.0,
        inertia: Annotated[float, About('moment of inertia', 'kg m^2', minimum=1e-6)] = 0.01,
        drag: Annotated[float, About('drag by mass', '1/s', minimum=0.0)] = 0.3,
    ) -> None:
        self._mass, self._inertia, self._drag = mass, inertia, drag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocities and the accelerations."""
        tilt, vx, vz, turn = (x[..., k] for k in range(2, 6))
        lift = u[..., 0] / self._mass
        ahead = -lift * np.sin(tilt) - self._drag * vx
        up = lift * np.cos(tilt) - 9.80665 - self._drag * vz
        return np.stack((vx, vz, turn, ahead, up, u[..., 1] / self._inertia), axis=-1)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of gusts."""
        return np.diag([0.0, 0.0, 0.0, 0.02, 0.02, 0.05])


class Altimeter(Sensor):
    """The distance to flat ground along the axis of a tilted body, z / cos(tilt)."""

    def __init__(self, state: Space, noise: Sequence[float]) -> None:
        self._z, self._tilt = state.indices(('z', 'tilt'))
        self.output = Space(('distance',), ('m',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the distance."""
        return np.asarray(x[..., self._z] / np.cos(x[..., self._tilt]))[..., np.newaxis]
