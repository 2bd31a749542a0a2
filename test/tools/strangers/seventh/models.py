# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the seventh set of systems have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances

from ..sixth.models import _stack

_GRAVITY = 9.80665


class Yacht(Model):
    """A sailing yacht that makes leeway, by the forces of its sails and the rudder."""

    state = Space(
        ('x', 'y', 'psi', 'turn', 'speed', 'side'),
        ('m', 'm', 'rad', 'rad/s', 'm/s', 'm/s'),
        angles=('psi',),
    )
    input = Space(('ahead', 'aside', 'rudder'), ('m/s^2', 'm/s^2', 'rad'))
    max_step = 0.1

    def __init__(
        self,
        steering: Annotated[float, About('turn rate by speed and rudder', '1/m')] = 0.5,
        lag: Annotated[float, About('of the turn rate', 's', minimum=0.05)] = 1.2,
        drag: Annotated[float, About('decay of the speed', '1/s', minimum=0.0)] = 0.2,
        leeway: Annotated[float, About('velocity by acceleration aside', 's')] = 1.5,
    ) -> None:
        self._steering, self._lag, self._drag, self._leeway = steering, lag, drag, leeway

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocities, and the lags behind rudder and sails."""
        psi, turn, speed, side = (x[..., k] for k in range(2, 6))
        c, s = np.cos(psi), np.sin(psi)
        return _stack(
            speed * c - side * s,
            speed * s + side * c,
            turn,
            (self._steering * speed * u[..., 2] - turn) / self._lag,
            u[..., 0] - self._drag * speed,
            (self._leeway * u[..., 1] - side) / 2.0,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of turn and velocities."""
        return np.diag([0.0, 0.0, 0.0, 0.001, 0.005, 0.005])


class Parafoil(Model):
    """A load below a steered parafoil, in a wind that changes slowly."""

    state = Space(
        ('x', 'y', 'z', 'psi', 'turn', 'sink', 'east', 'north'),
        ('m', 'm', 'm', 'rad', 'rad/s', 'm/s', 'm/s', 'm/s'),
        angles=('psi',),
    )
    input = Space(('brake',), ('1',))
    max_step = 0.1

    def __init__(
        self,
        airspeed: Annotated[float, About('along the heading', 'm/s', minimum=0.1)] = 11.0,
        response: Annotated[float, About('turn rate by the brake', 'rad/s')] = 0.5,
        glide: Annotated[float, About('sink without a brake', 'm/s', minimum=0.0)] = 4.5,
    ) -> None:
        self._airspeed, self._response, self._glide = airspeed, response, glide

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocities, and the lags of turn and sink."""
        psi, turn, sink, east, north = (x[..., k] for k in range(3, 8))
        brake = u[..., 0]
        return _stack(
            self._airspeed * np.cos(psi) + east,
            self._airspeed * np.sin(psi) + north,
            -sink,
            turn,
            (self._response * brake - turn) / 0.8,
            (self._glide + 1.5 * np.abs(brake) - sink) / 1.5,
            0.0 * east,
            0.0 * north,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of turn, sink and wind."""
        return np.diag([0.0, 0.0, 0.0, 0.0, 0.004, 0.02, 0.02, 0.02])


class Elbow(Model):
    """A forearm that swings below an elbow, which a motor drives through a spring."""

    state = Space(('motor', 'fast', 'joint', 'rate'), ('rad', 'rad/s', 'rad', 'rad/s'))
    input = Space(('torque',), ('N m',))
    max_step = 0.01

    def __init__(
        self,
        mass: Annotated[float, About('of the forearm', 'kg', minimum=0.1)] = 3.5,
        spring: Annotated[float, About('stiffness', 'N m', minimum=1.0)] = 120.0,
        damping: Annotated[float, About('of the spring', 'N m s', minimum=0.0)] = 1.5,
        friction: Annotated[float, About('of the motor', 'N m s', minimum=0.0)] = 2.0,
    ) -> None:
        self._mass, self._spring = mass, spring
        self._damping, self._friction = damping, friction

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates and the accelerations by motor, spring and weight."""
        motor, fast, joint, rate = (x[..., k] for k in range(4))
        torque = self._spring * (motor - joint) + self._damping * (fast - rate)
        weight = 0.25 * self._mass * _GRAVITY * np.sin(joint)
        return _stack(
            fast,
            (u[..., 0] - self._friction * fast - torque) / 0.15,
            rate,
            (torque - weight - 0.3 * rate) / (0.08 * self._mass),
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of both rates."""
        return np.diag([0.0, 0.02, 0.0, 0.02])


class Mixer(Model):
    """A tank in which brine and water are mixed, with an open outlet."""

    state = Space(('level', 'salt'), ('m', 'g/l'))
    input = Space(('brine', 'water'), ('m^3/s', 'm^3/s'))
    max_step = 0.5

    def __init__(
        self,
        outlet: Annotated[float, About('flow by the root of the level', 'm^2.5/s')] = 0.015,
        strength: Annotated[float, About('concentration of the brine', 'g/l')] = 10.0,
    ) -> None:
        self._outlet, self._strength = outlet, strength

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the balances of volume and salt."""
        level, salt = np.maximum(x[..., 0], 0.01), x[..., 1]
        brine, water = u[..., 0], u[..., 1]
        return _stack(
            (brine + water - self._outlet * np.sqrt(level)) / 0.5,
            (brine * (self._strength - salt) - water * salt) / (0.5 * level),
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of level and salt."""
        return np.diag([2e-6, 1e-3])


class Outflow(Sensor):
    """The flow through the outlet of a tank."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        outlet: Annotated[float, About('flow by the root of the level', 'm^2.5/s')] = 0.015,
    ) -> None:
        self._index = state.indices(('level',))[0]
        self._outlet = outlet
        self.output = Space(('flow',), ('m^3/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the flow."""
        return _stack(self._outlet * np.sqrt(np.maximum(x[..., self._index], 0.01)))
