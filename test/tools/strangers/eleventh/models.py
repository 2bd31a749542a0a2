# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the eleventh set of systems have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances

from ..sixth.models import _stack


class TwinRotor(Model):
    """A beam on two hinges with a rotor at each end; its nose goes down with ``pitch``."""

    state = Space(('yaw', 'pitch', 'turn', 'nod'), ('rad', 'rad', 'rad/s', 'rad/s'))
    input = Space(('main', 'tail'), ('N', 'N'))
    max_step = 0.02

    def __init__(
        self,
        low: Annotated[float, About('from the hinge down to the centre of mass', 'm')] = 0.03,
        arm: Annotated[float, About('from the middle to the main rotor', 'm')] = 0.25,
        tail_arm: Annotated[float, About('from the middle to the tail', 'm')] = 0.25,
        reaction: Annotated[float, About('torque by thrust of the main rotor', 'm')] = 0.03,
        friction: Annotated[float, About('about the vertical', 'N m s', minimum=0.0)] = 0.03,
        damping: Annotated[float, About('of the pitch', 'N m s', minimum=0.0)] = 0.03,
    ) -> None:
        self._weight, self._friction, self._damping = 9.80665 * low, friction, damping
        self._arms = arm, tail_arm, reaction
        self._rolling, self._nodding, self._turning = 0.002 + low**2, 0.03 + low**2, 0.031

    def _about_vertical(self, pitch: Array) -> Array:
        """Return the moment of inertia of beam and post."""
        s = np.sin(pitch) ** 2
        return np.asarray(0.001 + self._rolling * s + self._turning * (1.0 - s))

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates, and the accelerations by Lagrange's equations."""
        pitch, turn, nod = x[..., 1], x[..., 2], x[..., 3]
        s, c = np.sin(pitch), np.cos(pitch)
        arm, tail_arm, reaction = self._arms
        swing = (self._rolling - self._turning) * s * c
        about = (reaction * u[..., 0] - tail_arm * u[..., 1]) * c - self._friction * turn
        across = -arm * u[..., 0] - self._weight * s - self._damping * nod + swing * turn**2
        return _stack(
            turn,
            nod,
            (about - 2.0 * swing * turn * nod) / self._about_vertical(pitch),
            across / self._nodding,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the density of the rates by random torques at both hinges."""
        density = np.zeros((*x.shape, 4))
        density[..., 2, 2] = 1e-5 / self._about_vertical(x[..., 1]) ** 2
        density[..., 3, 3] = 1e-5 / self._nodding**2
        return density


class BeamGyro(Sensor):
    """The turn rates of the beam about its own axes."""

    def __init__(self, state: Space, noise: Sequence[float]) -> None:
        self._states = state.indices(('pitch', 'turn', 'nod'))
        self.output = Space(('x', 'y', 'z'), ('rad/s',) * 3)
        self.covariance = variances('noise', noise, 3)

    def measure(self, x: Array) -> Array:
        """Return the turn rates."""
        pitch, turn, nod = (x[..., k] for k in self._states)
        return _stack(-turn * np.sin(pitch), nod, turn * np.cos(pitch))


class Cubli(Model):
    """A plate that hangs from a corner, with a wheel whose motor pushes both."""

    state = Space(('tilt', 'rate', 'spin'), ('rad', 'rad/s', 'rad/s'))
    input = Space(('torque',), ('N m',))
    max_step = 0.01

    def __init__(
        self,
        weight: Annotated[float, About('by its distance from the corner', 'N m')] = 0.666852,
        inertia: Annotated[float, About('about the corner', 'kg m^2', minimum=1e-9)] = 0.00912,
        wheel: Annotated[float, About('inertia of the wheel', 'kg m^2', minimum=1e-9)] = 0.0004,
        damping: Annotated[float, About('of the hinge', 'N m s', minimum=0.0)] = 0.004,
        drag: Annotated[float, About('of the wheel', 'N m s', minimum=0.0)] = 0.00004,
    ) -> None:
        self._weight, self._inertia, self._wheel = weight, inertia, wheel
        self._damping, self._drag = damping, drag

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates; the wheel spins against the plate."""
        tilt, rate, spin = x[..., 0], x[..., 1], x[..., 2]
        torque = u[..., 0] - self._drag * spin
        pull = -self._weight * np.sin(tilt) - self._damping * rate - torque
        growth = pull / self._inertia
        return _stack(rate, growth, torque / self._wheel - growth)

    def noise_density(self, x: Array) -> Array:
        """Return the density of the rates by random torques at hinge and wheel."""
        plate, wheel = 4e-6 / self._inertia**2, 1e-7
        both = np.array([1.0 / self._inertia, -1.0 / self._inertia - 1.0 / self._wheel])
        density = np.zeros((3, 3))
        density[1:, 1:] = plate * np.array([[1.0, -1.0], [-1.0, 1.0]])
        density[1:, 1:] += wheel * np.outer(both, both)
        return density


class Glucose(Model):
    """Glucose in blood and skin, insulin in the blood and where it acts, after Bergman."""

    state = Space(('blood', 'remote', 'insulin', 'tissue'), ('mg/dl', 'mU/l', 'mU/l', 'mg/dl'))
    input = Space(('insulin', 'meal'), ('mU/l/s', 'mg/dl/s'))
    max_step = 20.0

    def __init__(
        self,
        sensitivity: Annotated[float, About('fall by insulin', 'l/(mU s)')] = 1.5e-5,
        effectiveness: Annotated[float, About('return by itself', '1/s', minimum=0.0)] = 2e-4,
        action: Annotated[float, About('how soon insulin acts', '1/s', minimum=0.0)] = 6e-4,
        clearance: Annotated[float, About('loss of insulin', '1/s', minimum=0.0)] = 1.5e-3,
        skin: Annotated[float, About('lag of the skin', 's', minimum=1.0)] = 400.0,
    ) -> None:
        self._sensitivity, self._effectiveness = sensitivity, effectiveness
        self._action, self._clearance, self._skin = action, clearance, skin

    def derivative(self, x: Array, u: Array) -> Array:
        """Return meals, losses and lags."""
        blood, remote, insulin, tissue = (x[..., k] for k in range(4))
        fall = self._effectiveness * (blood - 100.0) + self._sensitivity * remote * blood
        return _stack(
            u[..., 1] - fall,
            self._action * (insulin - remote),
            u[..., 0] - self._clearance * insulin,
            (blood - tissue) / self._skin,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.008, 4e-5, 4e-5, 0.002])


class Penstock(Model):
    """A tunnel from a lake to a turbine, with a surge tank; the level is above the lake's."""

    state = Space(('flow', 'level', 'gate'), ('m^3/s', 'm', ''))
    input = Space(('wish',), ('',))
    max_step = 1.0

    def __init__(
        self,
        friction: Annotated[float, About('of the tunnel', 's^2/m^5', minimum=0.0)] = 0.003,
        area: Annotated[float, About('of the tank', 'm^2', minimum=1e-3)] = 100.0,
        slow: Annotated[float, About('lag of the gate', 's', minimum=1e-3)] = 6.0,
        size: Annotated[float, About('flow by gate', 'm^2.5/s', minimum=0.0)] = 5.6,
        inertance: Annotated[float, About('growth of the flow by head', 'm^2/s^2')] = 0.078,
    ) -> None:
        self._friction, self._area, self._slow = friction, area, slow
        self._size, self._inertance = size, inertance

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the changes of flow, level and gate."""
        flow, level, gate = x[..., 0], x[..., 1], x[..., 2]
        used = self._size * gate * np.sqrt(80.0 + level)
        return _stack(
            self._inertance * (-level - self._friction * flow * np.abs(flow)),
            (flow - used) / self._area,
            (u[..., 0] - gate) / self._slow,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.02, 0.0004, 0.00002])


class Power(Sensor):
    """What the turbine gives, by its flow and its head."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        size: Annotated[float, About('flow by gate', 'm^2.5/s', minimum=0.0)] = 5.6,
        yields: Annotated[float, About('power by flow and head', 'MW s/m^4')] = 0.0088,
    ) -> None:
        self._indices = state.indices(('level', 'gate'))
        self._size, self._yields = size, yields
        self.output = Space(('power',), ('MW',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the power."""
        level, gate = (x[..., k] for k in self._indices)
        return _stack(self._yields * self._size * gate * (80.0 + level) ** 1.5)
