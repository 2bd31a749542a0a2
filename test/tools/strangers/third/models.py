# SPDX-License-Identifier: Apache-2.0
"""Models and sensors that the owners of the third set of robots have written for the package.

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


class Forklift(Model):
    """A truck whose rear wheel drives and steers; the place is the middle of its front axle."""

    state = Space(
        ('x', 'y', 'psi', 'v', 'steering'), ('m', 'm', 'rad', 'm/s', 'rad'), angles=('psi',)
    )
    input = Space(('speed', 'wheel'), ('m/s', 'rad'))
    max_step = 0.05

    def __init__(
        self,
        wheelbase: Annotated[float, About('from the axle to the rear wheel', 'm')] = 1.4,
        lag: Annotated[float, About('time constant of the speed', 's', minimum=0.05)] = 0.6,
        servo: Annotated[float, About('time constant of the steering', 's', minimum=0.05)] = 0.3,
    ) -> None:
        self._base, self._lag, self._servo = wheelbase, lag, servo

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity of the axle, and the rates of heading, speed and steering."""
        psi, v, steering = x[..., 2], x[..., 3], x[..., 4]
        return _stack(
            v * np.cos(psi),
            v * np.sin(psi),
            -v * np.tan(steering) / self._base,
            (u[..., 0] - v) / self._lag,
            (u[..., 1] - steering) / self._servo,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the drive and of the steering."""
        return np.diag([0.0, 0.0, 0.0, 0.02, 0.001])


class DriveWheel(Sensor):
    """The turn rate of the steered rear wheel."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        radius: Annotated[float, About('radius of the wheel', 'm', minimum=0.01)] = 0.15,
    ) -> None:
        self._v, self._steering = state.indices(('v', 'steering'))
        self._radius = radius
        self.output = Space(('rate',), ('rad/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the turn rate of the wheel."""
        rolled = x[..., self._v] / np.cos(x[..., self._steering])
        return np.asarray(rolled[..., np.newaxis] / self._radius)


class RearTurn(Sensor):
    """The turn rate of a truck that is steered behind."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        wheelbase: Annotated[float, About('from the axle to the rear wheel', 'm')] = 1.4,
    ) -> None:
        self._v, self._steering = state.indices(('v', 'steering'))
        self._base = wheelbase
        self.output = Space(('turn',), ('rad/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the turn rate."""
        turn = -x[..., self._v] * np.tan(x[..., self._steering]) / self._base
        return np.asarray(turn[..., np.newaxis])


class Boom(Model):
    """The boom of an excavator, whose rate follows the opening of a valve as a lag."""

    state = Space(('angle', 'rate'), ('rad', 'rad/s'))
    input = Space(('valve',), ('',))
    max_step = 0.05

    def __init__(
        self,
        gain: Annotated[float, About('rate with an open valve', 'rad/s')] = 0.5,
        lag: Annotated[float, About('time constant', 's', minimum=0.01)] = 0.35,
    ) -> None:
        self._gain, self._lag = gain, lag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of angle and rate."""
        rate = x[..., 1]
        return _stack(rate, (self._gain * u[..., 0] - rate) / self._lag)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral density of the soil's pushes."""
        return np.diag([0.0, 0.003])


class BoomImu(Sensor):
    """Turn rate, and specific force along the boom, of an IMU at some distance from the pivot."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        radius: Annotated[float, About('distance from the pivot', 'm')] = 0.4,
    ) -> None:
        self._angle, self._rate = state.indices(('angle', 'rate'))
        self._radius = radius
        self.output = Space(('rate', 'force'), ('rad/s', 'm/s^2'))
        self.covariance = variances('noise', noise, 2)

    def measure(self, x: Array) -> Array:
        """Return the rate, and gravity less the acceleration towards the pivot."""
        angle, rate = x[..., self._angle], x[..., self._rate]
        return _stack(rate, _GRAVITY * np.sin(angle) - self._radius * rate**2)


class Cylinder(Sensor):
    """The length of a hydraulic cylinder between two bolts, by the law of cosines."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        on_frame: Annotated[float, About('from the pivot to the lower bolt', 'm')] = 0.6,
        on_boom: Annotated[float, About('from the pivot to the upper bolt', 'm')] = 1.8,
    ) -> None:
        (self._angle,) = state.indices(('angle',))
        self._squares, self._product = on_frame**2 + on_boom**2, 2.0 * on_frame * on_boom
        self.output = Space(('length',), ('m',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the length; the frame's side of the triangle is 1.2 rad below the horizon."""
        cosine = np.cos(x[..., self._angle, np.newaxis] + 1.2)
        return np.asarray(np.sqrt(self._squares - self._product * cosine))


class Heater(Model):
    """A heated plate in a stream of air of a fan."""

    state = Space(('plate', 'air'), ('degC', 'degC'))
    input = Space(('power', 'fan'), ('W', ''))
    max_step = 0.5

    def __init__(
        self,
        plate_capacity: Annotated[float, About('of the plate', 'J/K', minimum=1.0)] = 40.0,
        air_capacity: Annotated[
            float, About('of the air and its duct', 'J/K', minimum=1.0)
        ] = 25.0,
        still: Annotated[float, About('transfer without the fan', 'W/K')] = 0.6,
        blown: Annotated[float, About('further transfer at full speed', 'W/K')] = 1.8,
        room: Annotated[float, About('temperature of the room', 'degC')] = 20.0,
    ) -> None:
        self._plate, self._air = plate_capacity, air_capacity
        self._still, self._blown, self._room = still, blown, room

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of both temperatures."""
        plate, air, fan = x[..., 0], x[..., 1], u[..., 1]
        passed = (self._still + self._blown * fan) * (plate - air)
        left = (0.8 + 1.5 * fan) * (air - self._room)
        return _stack((u[..., 0] - passed) / self._plate, (passed - left) / self._air)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of both temperatures."""
        return np.diag([0.01, 0.01])


class Hovercraft(Model):
    """A hovercraft that glides to all sides, with one fan and a rudder."""

    state = Space(
        ('x', 'y', 'psi', 'u', 'v', 'r'), ('m', 'm', 'rad', 'm/s', 'm/s', 'rad/s'), angles=('psi',)
    )
    input = Space(('thrust', 'moment'), ('N', 'N m'))
    max_step = 0.05

    def __init__(
        self,
        mass: Annotated[float, About('mass', 'kg', minimum=0.1)] = 12.0,
        inertia: Annotated[float, About('moment of inertia', 'kg m^2', minimum=0.01)] = 1.5,
        drag: Annotated[float, About('drag', 'N s/m', minimum=0.0)] = 3.0,
        turn_drag: Annotated[float, About('drag of turning', 'N m s', minimum=0.0)] = 1.2,
    ) -> None:
        self._mass, self._inertia, self._drag, self._turn = mass, inertia, drag, turn_drag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity over ground, the turn rate, and the accelerations."""
        psi, ahead, left, r = (x[..., k] for k in range(2, 6))
        c, s, decay = np.cos(psi), np.sin(psi), self._drag / self._mass
        return _stack(
            c * ahead - s * left,
            s * ahead + c * left,
            r,
            u[..., 0] / self._mass - decay * ahead + r * left,
            -decay * left - r * ahead,
            (u[..., 1] - self._turn * r) / self._inertia,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the wind."""
        return np.diag([0.0, 0.0, 0.0, 0.01, 0.01, 0.003])


class PlaneField(Sensor):
    """The two horizontal components of the field of the Earth, by the axes of the vehicle."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        strength: Annotated[float, About('horizontal field, to the north', 'T')] = 2e-5,
    ) -> None:
        (self._psi,) = state.indices(('psi',))
        self._strength = strength
        self.output = Space(('forward', 'left'), ('T', 'T'))
        self.covariance = variances('noise', noise, 2)

    def measure(self, x: Array) -> Array:
        """Return the components forward and left; north is y."""
        psi = x[..., self._psi]
        return _stack(self._strength * np.sin(psi), self._strength * np.cos(psi))


class Glider(Model):
    """A glider in a vertical plane; the coefficient of lift is the input."""

    state = Space(('h', 'speed', 'path'), ('m', 'm/s', 'rad'))
    input = Space(('lift',), ('',))
    max_step = 0.1

    def __init__(
        self,
        area: Annotated[float, About('half the air density, area by mass', '1/m')] = 0.018,
        drag: Annotated[float, About('coefficient of drag without lift', '')] = 0.02,
        induced: Annotated[float, About('drag by the square of lift', '')] = 0.03,
    ) -> None:
        self._area, self._drag, self._induced = area, drag, induced

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of height, airspeed and the angle of the path."""
        speed, path, lift = x[..., 1], x[..., 2], u[..., 0]
        brake = self._area * (self._drag + self._induced * lift**2) * speed**2
        bend = self._area * lift * speed - _GRAVITY * np.cos(path) / speed
        return _stack(speed * np.sin(path), -_GRAVITY * np.sin(path) - brake, bend)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of gusts."""
        return np.diag([0.02, 0.02, 5e-5])


class Pitot(Sensor):
    """The pressure of the wind, half the air density by the square of the airspeed."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        density: Annotated[float, About('of the air', 'kg/m^3', minimum=0.1)] = 1.2,
    ) -> None:
        (self._speed,) = state.indices(('speed',))
        self._half = 0.5 * density
        self.output = Space(('pressure',), ('Pa',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the pressure."""
        return np.asarray(self._half * x[..., self._speed, np.newaxis] ** 2)


class Variometer(Sensor):
    """The rate of climb."""

    def __init__(self, state: Space, noise: Sequence[float]) -> None:
        self._speed, self._path = state.indices(('speed', 'path'))
        self.output = Space(('climb',), ('m/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the rate of climb."""
        climb = x[..., self._speed] * np.sin(x[..., self._path])
        return np.asarray(climb[..., np.newaxis])


class Rov(Model):
    """An underwater vehicle with thrusters for surge, heave and yaw, and quadratic drag."""

    state = Space(
        ('x', 'y', 'z', 'psi', 'u', 'w', 'r'),
        ('m', 'm', 'm', 'rad', 'm/s', 'm/s', 'rad/s'),
        angles=('psi',),
    )
    input = Space(('surge', 'heave', 'yaw'), ('N', 'N', 'N m'))
    max_step = 0.05

    def __init__(
        self,
        mass: Annotated[float, About('mass with the water around', 'kg', minimum=1.0)] = 90.0,
        inertia: Annotated[float, About('moment of inertia', 'kg m^2', minimum=0.1)] = 8.0,
        drag: Annotated[float, About('drag of surge', 'N s^2/m^2', minimum=0.0)] = 60.0,
        heave_drag: Annotated[float, About('drag of heave', 'N s^2/m^2', minimum=0.0)] = 120.0,
        yaw_drag: Annotated[float, About('drag of yaw', 'N m s^2', minimum=0.0)] = 12.0,
    ) -> None:
        self._mass, self._inertia = mass, inertia
        self._drag = drag, heave_drag, yaw_drag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return velocities and accelerations."""
        psi, ahead, up, r = (x[..., k] for k in range(3, 7))
        surge, heave, yaw = (
            u[..., k] - drag * v * np.abs(v)
            for k, (drag, v) in enumerate(zip(self._drag, (ahead, up, r)))
        )
        return _stack(
            ahead * np.cos(psi),
            ahead * np.sin(psi),
            up,
            r,
            surge / self._mass,
            heave / self._mass,
            yaw / self._inertia,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the pull of the tether."""
        return np.diag([0.0, 0.0, 0.0, 0.0, 0.001, 0.0005, 0.001])


class Battery(Model):
    """A pack of six cells with one pair of resistor and capacitor, and its temperature."""

    state = Space(('current', 'charge', 'lag', 'temperature'), ('A', '', 'V', 'degC'))
    input = Space(('demand',), ('A',))
    max_step = 0.2

    def __init__(
        self,
        capacity: Annotated[float, About('charge when full', 'A s', minimum=1.0)] = 7200.0,
        resistance: Annotated[float, About('of the pack', 'Ohm', minimum=0.0)] = 0.03,
        slow_resistance: Annotated[float, About('of the pair', 'Ohm', minimum=1e-6)] = 0.02,
        slow_time: Annotated[float, About('time constant of the pair', 's', minimum=0.1)] = 10.0,
        heat: Annotated[float, About('heat capacity', 'J/K', minimum=1.0)] = 250.0,
    ) -> None:
        self._capacity, self._resistance, self._heat = capacity, resistance, heat
        self._slow, self._time = slow_resistance, slow_time

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of current, charge, slow voltage and temperature."""
        current, lag, temperature = x[..., 0], x[..., 2], x[..., 3]
        warmed = self._resistance * current**2 + lag * current - 1.2 * (temperature - 20.0)
        return _stack(
            (u[..., 0] - current) / 0.4,
            -current / self._capacity,
            (self._slow * current - lag) / self._time,
            warmed / self._heat,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the load, and of what the model leaves out."""
        return np.diag([2.0, 1e-8, 1e-5, 1e-3])


class Terminals(Sensor):
    """The voltage of the pack under load."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        resistance: Annotated[float, About('of the pack', 'Ohm', minimum=0.0)] = 0.03,
    ) -> None:
        self._states = state.indices(('current', 'charge', 'lag'))
        self._resistance = resistance
        self.output = Space(('voltage',), ('V',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the voltage at rest, less what the load takes."""
        current, charge, lag = (x[..., k] for k in self._states)
        rest = 20.4 + 4.2 * charge + 0.6 * np.exp(-8.0 * (1.0 - charge))
        return np.asarray((rest - self._resistance * current - lag)[..., np.newaxis])


class Gimbal(Model):
    """A camera that pans and tilts; its centre of mass is a little ahead of the tilt axis."""

    state = Space(
        ('pan', 'pan_rate', 'tilt', 'tilt_rate'),
        ('rad', 'rad/s', 'rad', 'rad/s'),
        angles=('pan', 'tilt'),
    )
    input = Space(('pan_torque', 'tilt_torque'), ('N m', 'N m'))
    max_step = 0.02

    def __init__(
        self,
        pan_inertia: Annotated[float, About('about the pan axis', 'kg m^2')] = 0.012,
        tilt_inertia: Annotated[float, About('about the tilt axis', 'kg m^2')] = 0.006,
        friction: Annotated[float, About('viscous, of each axis', 'N m s', minimum=0.0)] = 0.01,
        unbalance: Annotated[float, About('weight by its distance', 'N m')] = 0.04,
    ) -> None:
        self._inertia = pan_inertia, tilt_inertia
        self._friction, self._unbalance = friction, unbalance

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of both angles and both turn rates."""
        pan_rate, tilt, tilt_rate = x[..., 1], x[..., 2], x[..., 3]
        weight = self._unbalance * np.cos(tilt)
        return _stack(
            pan_rate,
            (u[..., 0] - self._friction * pan_rate) / self._inertia[0],
            tilt_rate,
            (u[..., 1] - self._friction * tilt_rate + weight) / self._inertia[1],
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the random torques."""
        return np.diag([0.0, 0.05, 0.0, 0.05])


class CameraGyro(Sensor):
    """The turn rates of the camera about its own axes."""

    def __init__(self, state: Space, noise: Sequence[float]) -> None:
        self._states = state.indices(('pan_rate', 'tilt', 'tilt_rate'))
        self.output = Space(('x', 'y', 'z'), ('rad/s',) * 3)
        self.covariance = variances('noise', noise, 3)

    def measure(self, x: Array) -> Array:
        """Return the turn rates."""
        pan_rate, tilt, tilt_rate = (x[..., k] for k in self._states)
        return _stack(-pan_rate * np.sin(tilt), tilt_rate, pan_rate * np.cos(tilt))
