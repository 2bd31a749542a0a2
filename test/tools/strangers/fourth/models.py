# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the fourth set of robots have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Space

_GRAVITY = 9.80665


def _stack(*rates: Array) -> Array:
    return np.stack(np.broadcast_arrays(*rates), axis=-1)


class Tractor(Model):
    """A tractor that pulls an implement; the place is the middle of the rear axle."""

    state = Space(
        ('x', 'y', 'psi', 'hitch', 'v', 'steering'),
        ('m', 'm', 'rad', 'rad', 'm/s', 'rad'),
        angles=('psi', 'hitch'),
    )
    input = Space(('speed', 'wheel'), ('m/s', 'rad'))
    max_step = 0.05

    def __init__(
        self,
        wheelbase: Annotated[float, About('between the axles', 'm', minimum=0.1)] = 2.8,
        overhang: Annotated[float, About('from the rear axle to the hitch', 'm')] = 0.9,
        implement: Annotated[float, About('from the hitch to its axle', 'm', minimum=0.1)] = 4.0,
    ) -> None:
        self._base, self._overhang, self._implement = wheelbase, overhang, implement

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity of the axle, and the rates of all angles and of the speed."""
        psi, hitch, v, steering = (x[..., k] for k in range(2, 6))
        turn = v * np.tan(steering) / self._base
        lateral = v * np.sin(hitch) - self._overhang * turn * np.cos(hitch)
        return _stack(
            v * np.cos(psi),
            v * np.sin(psi),
            turn,
            turn - lateral / self._implement,
            u[..., 0] - v,
            (u[..., 1] - steering) / 0.4,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the hitch, the drive and the steering."""
        return np.diag([0.0, 0.0, 0.0, 1e-5, 0.01, 0.0005])


class Aeroplane(Model):
    """An aeroplane in coordinated turns, carried by a wind that changes slowly."""

    state = Space(
        ('x', 'y', 'psi', 'speed', 'bank', 'east', 'north'),
        ('m', 'm', 'rad', 'm/s', 'rad', 'm/s', 'm/s'),
        angles=('psi',),
    )
    input = Space(('throttle', 'roll'), ('m/s', 'rad'))
    max_step = 0.1

    def __init__(
        self,
        speed_lag: Annotated[float, About('time constant of the speed', 's', minimum=0.1)] = 4.0,
        roll_lag: Annotated[float, About('time constant of the bank', 's', minimum=0.1)] = 0.6,
    ) -> None:
        self._speed_lag, self._roll_lag = speed_lag, roll_lag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity over ground, the turn rate, and the lags behind the autopilot."""
        psi, speed, bank, east, north = (x[..., k] for k in range(2, 7))
        return _stack(
            speed * np.cos(psi) + east,
            speed * np.sin(psi) + north,
            _GRAVITY * np.tan(bank) / speed,
            (u[..., 0] - speed) / self._speed_lag,
            (u[..., 1] - bank) / self._roll_lag,
            np.zeros_like(speed),
            np.zeros_like(speed),
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of slip, gusts and the changes of the wind."""
        return np.diag([0.0, 0.0, 1e-5, 0.05, 0.001, 0.01, 0.01])


class Manipulator(Model):
    """An arm of two links in a vertical plane, driven at shoulder and elbow; it hangs at zero."""

    state = Space(('q1', 'w1', 'q2', 'w2'), ('rad', 'rad/s', 'rad', 'rad/s'))
    input = Space(('shoulder', 'elbow'), ('N m', 'N m'))
    max_step = 0.02

    def __init__(
        self,
        mass_1: Annotated[float, About('of the upper arm', 'kg', minimum=0.0)] = 3.0,
        mass_2: Annotated[float, About('of the forearm and the tool', 'kg', minimum=0.0)] = 2.0,
        length: Annotated[float, About('of the upper arm', 'm', minimum=0.01)] = 0.5,
        center_1: Annotated[float, About('centre of mass from the shoulder', 'm')] = 0.25,
        center_2: Annotated[float, About('centre of mass from the elbow', 'm')] = 0.2,
        friction: Annotated[float, About('viscous, of each joint', 'N m s', minimum=0.0)] = 0.6,
    ) -> None:
        self._first, self._second = mass_1 * center_1 + mass_2 * length, mass_2 * center_2
        self._coupling = self._second * length
        self._elbow = 0.1 + mass_2 * center_2**2
        self._shoulder = 0.3 + mass_1 * center_1**2 + mass_2 * length**2 + self._elbow
        self._friction = friction

    def derivative(self, x: Array, u: Array) -> Array:
        """Return rates and accelerations by the manipulator equation M q'' = torque."""
        q1, w1, q2, w2 = (x[..., k] for k in range(4))
        cosine, sine = self._coupling * np.cos(q2), self._coupling * np.sin(q2)
        m11, m12, m22 = self._shoulder + 2.0 * cosine, self._elbow + cosine, self._elbow
        outer = _GRAVITY * self._second * np.sin(q1 + q2)
        inner = _GRAVITY * self._first * np.sin(q1)
        shoulder = u[..., 0] - self._friction * w1 - inner - outer + sine * (2.0 * w1 + w2) * w2
        elbow = u[..., 1] - self._friction * w2 - outer - sine * w1**2
        determinant = m11 * m22 - m12**2
        return _stack(
            w1,
            (m22 * shoulder - m12 * elbow) / determinant,
            w2,
            (m11 * elbow - m12 * shoulder) / determinant,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of random accelerations."""
        return np.diag([0.0, 0.02, 0.0, 0.05])


class Balancer(Model):
    """An inverted pendulum on two wheels, whose motors act between body and wheels."""

    state = Space(('s', 'v', 'tilt', 'rate'), ('m', 'm/s', 'rad', 'rad/s'))
    input = Space(('torque',), ('N m',))
    max_step = 0.02

    def __init__(
        self,
        body_mass: Annotated[float, About('of the body', 'kg', minimum=0.01)] = 3.0,
        wheel_mass: Annotated[float, About('of wheels, with inertia', 'kg', minimum=0.0)] = 1.2,
        height: Annotated[float, About('of the centre of mass', 'm', minimum=0.01)] = 0.25,
        inertia: Annotated[float, About('of the body', 'kg m^2', minimum=0.0)] = 0.06,
        radius: Annotated[float, About('of the wheels', 'm', minimum=0.01)] = 0.08,
        friction: Annotated[float, About('of the gears', 'N m s', minimum=0.0)] = 0.03,
    ) -> None:
        self._mass, self._moment = body_mass + wheel_mass, body_mass * height
        self._inertia = inertia + body_mass * height**2
        self._radius, self._friction = radius, friction

    def derivative(self, x: Array, u: Array) -> Array:
        """Return velocity, turn rate, and the accelerations of wheels and body."""
        v, tilt, rate = x[..., 1], x[..., 2], x[..., 3]
        torque = u[..., 0] - self._friction * (v / self._radius - rate)
        coupling = self._moment * np.cos(tilt)
        force = torque / self._radius + self._moment * np.sin(tilt) * rate**2
        moment = self._moment * _GRAVITY * np.sin(tilt) - torque
        determinant = self._mass * self._inertia - coupling**2
        return _stack(
            v,
            (self._inertia * force - coupling * moment) / determinant,
            rate,
            (self._mass * moment - coupling * force) / determinant,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of random accelerations."""
        return np.diag([0.0, 0.01, 0.0, 0.05])
