# SPDX-License-Identifier: Apache-2.0
"""Models and sensors that the owners of the second set of robots have written for the package.

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


class Crane(Model):
    """A load on a rope below a trolley whose speed follows a command as a first-order lag."""

    state = Space(('x', 'v', 'swing', 'rate'), ('m', 'm/s', 'rad', 'rad/s'))
    input = Space(('speed',), ('m/s',))
    max_step = 0.05

    def __init__(
        self,
        length: Annotated[float, About('length of the rope', 'm', minimum=0.1)] = 8.0,
        lag: Annotated[float, About('time constant of the drive', 's', minimum=0.01)] = 0.5,
        damping: Annotated[float, About('decay of the swing', '1/s', minimum=0.0)] = 0.05,
    ) -> None:
        self._length, self._lag, self._damping = length, lag, damping

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of the trolley and of the swing."""
        v, swing, rate = x[..., 1], x[..., 2], x[..., 3]
        a = (u[..., 0] - v) / self._lag
        turn = -(_GRAVITY * np.sin(swing) + a * np.cos(swing)) / self._length
        return _stack(v, a, rate, turn - self._damping * rate)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the drive and of the wind."""
        return np.diag([0.0, 0.002, 0.0, 0.0002])


class Ferry(Model):
    """A ship with a first-order response to its rudder, in a current that varies slowly."""

    state = Space(
        ('x', 'y', 'psi', 'speed', 'omega', 'east', 'north'),
        ('m', 'm', 'rad', 'm/s', 'rad/s', 'm/s', 'm/s'),
        angles=('psi',),
    )
    input = Space(('engine', 'rudder'), ('m/s', 'rad'))
    max_step = 0.2

    def __init__(
        self,
        gain: Annotated[float, About('turn rate per angle of the rudder', '1/s')] = 0.25,
        lag: Annotated[float, About('time constant of the turn', 's', minimum=0.1)] = 8.0,
        surge: Annotated[float, About('time constant of the speed', 's', minimum=0.1)] = 12.0,
    ) -> None:
        self._gain, self._lag, self._surge = gain, lag, surge

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity over ground, and the rates of heading, speed and current."""
        psi, speed, omega, east, north = (x[..., k] for k in range(2, 7))
        still = np.zeros_like(psi)
        return _stack(
            speed * np.cos(psi) + east,
            speed * np.sin(psi) + north,
            omega,
            (u[..., 0] - speed) / self._surge,
            (self._gain * u[..., 1] - omega) / self._lag,
            still,
            still,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of waves and of the change of the current."""
        return np.diag([0.0, 0.0, 0.0, 0.002, 1e-5, 1e-5, 1e-5])


class Copter(Model):
    """The height of a multicopter with known thrust and linear drag."""

    state = Space(('z', 'v'), ('m', 'm/s'))
    input = Space(('thrust',), ('N',))
    max_step = 0.05

    def __init__(
        self,
        mass: Annotated[float, About('mass', 'kg', minimum=0.01)] = 1.5,
        drag: Annotated[float, About('drag by mass', '1/s', minimum=0.0)] = 0.4,
    ) -> None:
        self._mass, self._drag = mass, drag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of height and climb."""
        v = x[..., 1]
        return _stack(v, u[..., 0] / self._mass - _GRAVITY - self._drag * v)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral density of gusts."""
        return np.diag([0.0, 0.03])


class Chain(Model):
    """Three open tanks in series, each with an orifice at its bottom (Torricelli)."""

    state = Space(('top', 'middle', 'bottom'), ('m', 'm', 'm'))
    input = Space(('inflow',), ('m^3/s',))
    max_step = 1.0

    def __init__(
        self,
        area: Annotated[float, About('area of each tank', 'm^2', minimum=1e-4)] = 0.05,
        outlet: Annotated[float, About('area of each orifice', 'm^2', minimum=1e-7)] = 8e-4,
    ) -> None:
        self._area, self._outlet = area, outlet

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of the three levels."""
        flow = self._outlet * np.sqrt(2.0 * _GRAVITY * np.maximum(x, 1e-3))
        first, second, third = (flow[..., k] for k in range(3))
        return _stack(u[..., 0] - first, first - second, second - third) / self._area

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the levels."""
        return np.diag([4e-6, 4e-6, 4e-6])


class Outflow(Sensor):
    """The flow through the last orifice in litres per second."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        outlet: Annotated[float, About('area of the orifice', 'm^2', minimum=1e-7)] = 8e-4,
    ) -> None:
        (self._level,) = state.indices(('bottom',))
        self._outlet = outlet
        self.output = Space(('flow',), ('l/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the flow."""
        level = np.maximum(x[..., self._level, np.newaxis], 1e-3)
        return np.asarray(1000.0 * self._outlet * np.sqrt(2.0 * _GRAVITY * level))


class Rod(Model):
    """A pendulum: a mass at the end of a light rod, with a torque at its pivot."""

    state = Space(('theta', 'omega'), ('rad', 'rad/s'))
    input = Space(('torque',), ('N m',))
    max_step = 0.02

    def __init__(
        self,
        length: Annotated[float, About('length of the rod', 'm', minimum=0.01)] = 0.8,
        mass: Annotated[float, About('mass at its end', 'kg', minimum=0.01)] = 0.5,
        damping: Annotated[float, About('decay of the rate', '1/s', minimum=0.0)] = 0.3,
    ) -> None:
        self._pull, self._gain, self._damping = _GRAVITY / length, 1 / mass / length**2, damping

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of angle and turn rate."""
        theta, omega = x[..., 0], x[..., 1]
        turn = self._gain * u[..., 0] - self._pull * np.sin(theta) - self._damping * omega
        return _stack(omega, turn)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral density of the random torque."""
        return np.diag([0.0, 0.02])


class RodImu(Sensor):
    """Turn rate and specific force along the rod, of an IMU at some distance from the pivot."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        radius: Annotated[float, About('distance from the pivot', 'm')] = 0.6,
    ) -> None:
        self._theta, self._omega = state.indices(('theta', 'omega'))
        self._radius = radius
        self.output = Space(('rate', 'force'), ('rad/s', 'm/s^2'))
        self.covariance = variances('noise', noise, 2)

    def measure(self, x: Array) -> Array:
        """Return the turn rate and the force towards the pivot."""
        theta, omega = x[..., self._theta], x[..., self._omega]
        return _stack(omega, self._radius * omega**2 + _GRAVITY * np.cos(theta))


class Train(Model):
    """A train on a level track, with running resistance c_0 + c_1 v + c_2 v^2."""

    state = Space(('s', 'v'), ('m', 'm/s'))
    input = Space(('force',), ('N',))
    max_step = 0.2

    def __init__(
        self,
        mass: Annotated[float, About('mass', 'kg', minimum=1.0)] = 50000.0,
        rolling: Annotated[float, About('resistance by speed', 'N s/m', minimum=0.0)] = 300.0,
        air: Annotated[float, About('resistance by squared speed', 'N s^2/m^2')] = 6.0,
    ) -> None:
        self._mass, self._rolling, self._air = mass, rolling, air

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of place and speed."""
        v = x[..., 1]
        resistance = self._rolling * v + self._air * v * np.abs(v)
        return _stack(v, (u[..., 0] - resistance) / self._mass)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral density of gradients and wind."""
        return np.diag([0.0, 0.003])


class Arm(Model):
    """A joint that moves a link in a vertical plane; at zero, the link hangs down."""

    state = Space(('angle', 'rate'), ('rad', 'rad/s'))
    input = Space(('torque',), ('N m',))
    max_step = 0.02

    def __init__(
        self,
        mass: Annotated[float, About('mass at the tool', 'kg', minimum=0.0)] = 4.0,
        length: Annotated[float, About('from the joint to the tool', 'm', minimum=0.01)] = 0.3,
        rotor: Annotated[float, About('inertia of the drive', 'kg m^2', minimum=1e-4)] = 0.2,
        friction: Annotated[float, About('viscous friction', 'N m s', minimum=0.0)] = 1.2,
    ) -> None:
        self._weight, self._friction = mass * _GRAVITY * length, friction
        self._inertia = rotor + mass * length**2

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates of angle and turn rate."""
        angle, rate = x[..., 0], x[..., 1]
        torque = u[..., 0] - self._weight * np.sin(angle) - self._friction * rate
        return _stack(rate, torque / self._inertia)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral density of the random torque."""
        return np.diag([0.0, 0.05])


class Taxi(Model):
    """A car as a bicycle model: speed and steering follow their commands as first-order lags."""

    state = Space(
        ('x', 'y', 'psi', 'v', 'steering'), ('m', 'm', 'rad', 'm/s', 'rad'), angles=('psi',)
    )
    input = Space(('speed', 'wheel'), ('m/s', 'rad'))
    max_step = 0.05

    def __init__(
        self,
        wheelbase: Annotated[float, About('between the axles', 'm', minimum=0.1)] = 2.6,
        lag: Annotated[float, About('time constant of the speed', 's', minimum=0.05)] = 2.0,
        servo: Annotated[float, About('time constant of the steering', 's', minimum=0.05)] = 0.3,
    ) -> None:
        self._base, self._lag, self._servo = wheelbase, lag, servo

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity of the rear axle, and the rates of heading, speed and steering."""
        psi, v, steering = x[..., 2], x[..., 3], x[..., 4]
        return _stack(
            v * np.cos(psi),
            v * np.sin(psi),
            v * np.tan(steering) / self._base,
            (u[..., 0] - v) / self._lag,
            (u[..., 1] - steering) / self._servo,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the engine and of the steering."""
        return np.diag([0.0, 0.0, 0.0, 0.05, 0.0005])


class YawRate(Sensor):
    """The turn rate of a car, v tan(steering) / wheelbase."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        wheelbase: Annotated[float, About('between the axles', 'm', minimum=0.1)] = 2.6,
    ) -> None:
        self._v, self._steering = state.indices(('v', 'steering'))
        self._base = wheelbase
        self.output = Space(('turn',), ('rad/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the turn rate."""
        turn = x[..., self._v] * np.tan(x[..., self._steering]) / self._base
        return np.asarray(turn[..., np.newaxis])


class Sounder(Sensor):
    """The height above a flat bottom."""

    linear = True

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        bottom: Annotated[float, About('height of the bottom', 'm')] = -40.0,
    ) -> None:
        (self._z,) = state.indices(('z',))
        self._bottom = bottom
        self.output = Space(('distance',), ('m',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the distance to the bottom."""
        return np.asarray(x[..., self._z, np.newaxis] - self._bottom)
