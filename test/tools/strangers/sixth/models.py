# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the sixth set of robots have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances


def _stack(*rates: Array) -> Array:
    return np.stack(np.broadcast_arrays(*rates), axis=-1)


class Sailboat(Model):
    """A sailing boat in a wind that changes slowly; ``to_x`` and ``to_y`` are where it blows."""

    state = Space(
        ('x', 'y', 'psi', 'turn', 'v', 'to_x', 'to_y'),
        ('m', 'm', 'rad', 'rad/s', 'm/s', 'm/s', 'm/s'),
        angles=('psi',),
    )
    input = Space(('rudder',), ('rad',))
    max_step = 0.1

    def __init__(
        self,
        sail: Annotated[
            float, About('thrust by the square of the wind', '1/m', minimum=0.0)
        ] = 0.01,
        drag: Annotated[
            float, About('drag by the square of the speed', '1/m', minimum=0.0)
        ] = 0.09,
        leeway: Annotated[float, About('drift by the wind from the side', minimum=0.0)] = 0.03,
        gain: Annotated[float, About('turn rate by rudder and speed', '1/m')] = 0.35,
        lag: Annotated[float, About('time constant of turns', 's', minimum=0.05)] = 1.5,
    ) -> None:
        self._sail, self._drag, self._leeway = sail, drag, leeway
        self._gain, self._lag = gain, lag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates by the wind from the side, the drag and the rudder."""
        psi, turn, v, to_x, to_y = (x[..., k] for k in range(2, 7))
        c, s = np.cos(psi), np.sin(psi)
        across = to_y * c - to_x * s
        side = self._leeway * across
        return _stack(
            v * c - side * s,
            v * s + side * c,
            turn,
            (self._gain * v * u[..., 0] - turn) / self._lag,
            self._sail * across**2 - self._drag * v * np.abs(v),
            np.zeros_like(v),
            np.zeros_like(v),
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of waves and of the change of the wind."""
        return np.diag([0.0, 0.0, 0.0, 0.00003, 0.001, 0.0005, 0.0005])


class Vane(Sensor):
    """The speed of the apparent wind, and where it blows, from the bow to the left."""

    def __init__(self, state: Space, noise: Sequence[float]) -> None:
        self._indices = state.indices(('psi', 'v', 'to_x', 'to_y'))
        self.output = Space(('speed', 'angle'), ('m/s', 'rad'), angles=('angle',))
        self.covariance = variances('noise', noise, 2)

    def measure(self, x: Array) -> Array:
        """Return speed and angle."""
        psi, v, to_x, to_y = (x[..., k] for k in self._indices)
        c, s = np.cos(psi), np.sin(psi)
        ahead, left = to_x * c + to_y * s - v, to_y * c - to_x * s
        return _stack(np.hypot(ahead, left), np.arctan2(left, ahead))


class Knee(Model):
    """A knee with a motor behind a spring; ``motor`` is its angle behind the gear."""

    state = Space(('knee', 'bending', 'motor', 'spin'), ('rad', 'rad/s', 'rad', 'rad/s'))
    input = Space(('torque',), ('N m',))
    max_step = 0.01

    def __init__(
        self,
        inertia: Annotated[float, About('of the shank', 'kg m^2', minimum=0.001)] = 0.3,
        weight: Annotated[float, About('torque of the weight, horizontal', 'N m')] = 12.0,
        friction: Annotated[float, About('of the joint', 'N m s', minimum=0.0)] = 1.5,
        stiffness: Annotated[float, About('of the spring', 'N m', minimum=0.1)] = 150.0,
        rotor: Annotated[float, About('of the motor behind the gear', 'kg m^2', minimum=0.001)] = (
            0.15
        ),
        drag: Annotated[float, About('of motor and gear', 'N m s', minimum=0.0)] = 2.5,
    ) -> None:
        self._inertia, self._weight, self._friction = inertia, weight, friction
        self._stiffness, self._rotor, self._drag = stiffness, rotor, drag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the accelerations by spring, weight, friction and motor."""
        knee, bending, motor, spin = (x[..., k] for k in range(4))
        pull = self._stiffness * (motor - knee)
        fall = self._weight * np.sin(knee)
        return _stack(
            bending,
            (pull - fall - self._friction * bending) / self._inertia,
            spin,
            (u[..., 0] - pull - self._drag * spin) / self._rotor,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of what the leg and the gear add."""
        return np.diag([0.0, 0.1, 0.0, 0.1])
