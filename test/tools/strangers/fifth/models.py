# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the fifth set of robots have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances

_GRAVITY = 9.80665


def _stack(*rates: Array) -> Array:
    return np.stack(np.broadcast_arrays(*rates), axis=-1)


class Racer(Model):
    """A car as a bicycle with linear tyres; the place is its centre of mass."""

    state = Space(
        ('x', 'y', 'psi', 'v', 'side', 'turn', 'steering'),
        ('m', 'm', 'rad', 'm/s', 'm/s', 'rad/s', 'rad'),
        angles=('psi',),
    )
    input = Space(('speed', 'wheel'), ('m/s', 'rad'))
    max_step = 0.01

    def __init__(
        self,
        mass: Annotated[float, About('mass', 'kg', minimum=0.1)] = 3.5,
        inertia: Annotated[float, About('about the vertical', 'kg m^2', minimum=0.001)] = 0.06,
        axle: Annotated[float, About('from the centre to each axle', 'm', minimum=0.01)] = 0.16,
        stiffness: Annotated[float, About('of each axle in curves', 'N/rad', minimum=0.1)] = 35.0,
        servo: Annotated[float, About('time constant of the steering', 's', minimum=0.01)] = 0.12,
    ) -> None:
        self._mass, self._inertia, self._axle = mass, inertia, axle
        self._stiffness, self._servo = stiffness, servo

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates by the lateral forces of both axles."""
        psi, v, side, turn, steering = (x[..., k] for k in range(2, 7))
        speed = np.maximum(v, 0.3)
        front = self._stiffness * (steering - (side + self._axle * turn) / speed)
        rear = -self._stiffness * (side - self._axle * turn) / speed
        return _stack(
            v * np.cos(psi) - side * np.sin(psi),
            v * np.sin(psi) + side * np.cos(psi),
            turn,
            (u[..., 0] - v) / 0.4,
            (front + rear) / self._mass - v * turn,
            self._axle * (front - rear) / self._inertia,
            (u[..., 1] - steering) / self._servo,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the drive, bumps and the steering."""
        return np.diag([0.0, 0.0, 0.0, 0.05, 0.01, 0.05, 0.0005])


class RacerImu(Sensor):
    """The yaw rate of a car, and its lateral acceleration by the forces of its tyres."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        mass: Annotated[float, About('mass', 'kg', minimum=0.1)] = 3.5,
        stiffness: Annotated[float, About('of each axle in curves', 'N/rad', minimum=0.1)] = 35.0,
    ) -> None:
        self._indices = state.indices(('v', 'side', 'turn', 'steering'))
        self._gain = stiffness / mass
        self.output = Space(('turn', 'acceleration'), ('rad/s', 'm/s^2'))
        self.covariance = variances('noise', noise, 2)

    def measure(self, x: Array) -> Array:
        """Return the yaw rate and the lateral acceleration."""
        v, side, turn, steering = (x[..., k] for k in self._indices)
        slip = steering - 2.0 * side / np.maximum(v, 0.3)
        return _stack(turn, self._gain * slip)


class Scout(Model):
    """A multicopter whose autopilot follows attitude and climb, over a flat floor."""

    state = Space(
        ('roll', 'pitch', 'vx', 'vy', 'z', 'climb'), ('rad', 'rad', 'm/s', 'm/s', 'm', 'm/s')
    )
    input = Space(('to_left', 'nose', 'lift'), ('rad', 'rad', 'm/s'))
    max_step = 0.05

    def __init__(
        self,
        drag: Annotated[float, About('drag by mass', '1/s', minimum=0.0)] = 0.5,
        attitude_lag: Annotated[float, About('of roll and pitch', 's', minimum=0.02)] = 0.25,
        climb_lag: Annotated[float, About('of the climb', 's', minimum=0.02)] = 0.6,
    ) -> None:
        self._drag, self._attitude, self._climb = drag, attitude_lag, climb_lag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the lags behind the autopilot, and the accelerations by the tilt."""
        roll, pitch, vx, vy, _, climb = (x[..., k] for k in range(6))
        return _stack(
            (u[..., 0] - roll) / self._attitude,
            (u[..., 1] - pitch) / self._attitude,
            _GRAVITY * np.tan(pitch) - self._drag * vx,
            -_GRAVITY * np.tan(roll) - self._drag * vy,
            climb,
            (u[..., 2] - climb) / self._climb,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of attitude, gusts and climb."""
        return np.diag([0.0004, 0.0004, 0.03, 0.03, 0.0, 0.01])


class Flow(Sensor):
    """Optical flow, without that by rotation: velocity by height."""

    def __init__(self, state: Space, noise: Sequence[float]) -> None:
        self._indices = state.indices(('vx', 'vy', 'z'))
        self.output = Space(('ahead', 'left'), ('rad/s', 'rad/s'))
        self.covariance = variances('noise', noise, 2)

    def measure(self, x: Array) -> Array:
        """Return both components."""
        vx, vy, z = (x[..., k] for k in self._indices)
        z = np.maximum(z, 0.2)
        return _stack(vx / z, vy / z)


class Slant(Sensor):
    """The distance of the floor along the axis of a tilted multicopter."""

    def __init__(self, state: Space, noise: Sequence[float]) -> None:
        self._indices = state.indices(('roll', 'pitch', 'z'))
        self.output = Space(('distance',), ('m',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the distance."""
        roll, pitch, z = (x[..., k] for k in self._indices)
        return _stack(z / np.cos(roll) / np.cos(pitch))


class Turbine(Model):
    """A wind turbine: rotor and generator on an elastic shaft, in a wind about a mean."""

    state = Space(('rotor', 'twist', 'generator', 'wind'), ('rad/s', 'rad', 'rad/s', 'm/s'))
    input = Space(('torque',), ('N m',))
    max_step = 0.02

    def __init__(
        self,
        inertia: Annotated[float, About('of the rotor', 'kg m^2', minimum=1.0)] = 400.0,
        generator: Annotated[float, About('of the generator', 'kg m^2', minimum=1.0)] = 60.0,
        shaft: Annotated[float, About('stiffness of the shaft', 'N m', minimum=1.0)] = 8000.0,
        damping: Annotated[float, About('damping of the shaft', 'N m s', minimum=0.0)] = 80.0,
        mean_wind: Annotated[float, About('mean of the wind', 'm/s', minimum=0.0)] = 9.0,
    ) -> None:
        self._inertia, self._generator = inertia, generator
        self._shaft, self._damping, self._mean = shaft, damping, mean_wind

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the accelerations by wind, shaft and load, and the return of the wind."""
        rotor, twist, generator, wind = (x[..., k] for k in range(4))
        torque = self._shaft * twist + self._damping * (rotor - generator)
        return _stack(
            (10.5 * wind**2 - 3.7 * wind * rotor - torque) / self._inertia,
            rotor - generator,
            (torque - u[..., 0]) / self._generator,
            (self._mean - wind) / 20.0,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of both speeds and of the wind."""
        return np.diag([0.002, 0.0, 0.002, 0.06])
