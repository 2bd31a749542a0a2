# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the thirteenth set of systems have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances

from ..sixth.models import _stack


class Lungs(Model):
    """A hose and two parts of the lungs; the ventilator sets the pressure before the hose."""

    state = Space(('pressure', 'first', 'second'), ('cmH2O', 'l', 'l'))
    input = Space(('machine',), ('cmH2O',))
    max_step = 0.01

    def __init__(
        self,
        resistance: Annotated[float, About('of the first', 'cmH2O s/l', minimum=0.1)] = 8.0,
        compliance: Annotated[float, About('of the first', 'l/cmH2O', minimum=1e-4)] = 0.03,
        slow_resistance: Annotated[float, About('of the second', 'cmH2O s/l', minimum=0.1)] = 40.0,
        slow_compliance: Annotated[float, About('of the second', 'l/cmH2O', minimum=1e-4)] = 0.02,
        hose: Annotated[float, About('resistance of the hose', 'cmH2O s/l', minimum=0.1)] = 5.0,
        leak: Annotated[float, About('of the hose', 'l/s/cmH2O', minimum=0.0)] = 0.002,
    ) -> None:
        self._resistance, self._slow_resistance = resistance, slow_resistance
        self._compliance, self._slow_compliance = compliance, slow_compliance
        self._hose, self._leak = hose, leak

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the change of the pressure and both flows."""
        pressure, first, second = (x[..., k] for k in range(3))
        one = (pressure - first / self._compliance) / self._resistance
        two = (pressure - second / self._slow_compliance) / self._slow_resistance
        inward = (u[..., 0] - pressure) / self._hose
        return _stack((inward - one - two - self._leak * pressure) / 0.02, one, two)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.5, 0.00004, 0.00002])


class Flow(Sensor):
    """The flow into both parts of the lungs."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        resistance: Annotated[float, About('of the first', 'cmH2O s/l', minimum=0.1)] = 8.0,
        compliance: Annotated[float, About('of the first', 'l/cmH2O', minimum=1e-4)] = 0.03,
        slow_resistance: Annotated[float, About('of the second', 'cmH2O s/l', minimum=0.1)] = 40.0,
        slow_compliance: Annotated[float, About('of the second', 'l/cmH2O', minimum=1e-4)] = 0.02,
    ) -> None:
        self._indices = state.indices(('pressure', 'first', 'second'))
        self._parts = (resistance, compliance), (slow_resistance, slow_compliance)
        self.output = Space(('flow',), ('l/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the flow."""
        pressure, *volumes = (x[..., k] for k in self._indices)
        parts = zip(volumes, self._parts)
        flows = [(pressure - v / soft) / narrow for v, (narrow, soft) in parts]
        return _stack(flows[0] + flows[1])


class ColdStore(Model):
    """The air of a cold store, its goods, and the coil that a compressor cools."""

    state = Space(('air', 'goods', 'coil'), ('degC',) * 3)
    input = Space(('compressor', 'outside', 'door'), ('kW', 'degC', ''))
    max_step = 15.0

    def __init__(
        self,
        exchange: Annotated[float, About('of air and coil', 'kW/K', minimum=0.0)] = 2.0,
        door_flow: Annotated[float, About('of the open door', 'kW/K', minimum=0.0)] = 1.2,
        walls: Annotated[float, About('of the walls', 'kW/K', minimum=0.0)] = 0.12,
        racks: Annotated[float, About('of air and goods', 'kW/K', minimum=0.0)] = 0.8,
        performance: Annotated[float, About('heat by power', minimum=0.0)] = 2.5,
    ) -> None:
        self._exchange, self._door, self._walls = exchange, door_flow, walls
        self._racks, self._performance = racks, performance

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the changes of the temperatures."""
        air, goods, coil = (x[..., k] for k in range(3))
        inward = (self._walls + self._door * u[..., 2]) * (u[..., 1] - air)
        given, taken = self._racks * (goods - air), self._exchange * (air - coil)
        return _stack(
            (given + inward - taken) / 400.0,
            -given / 6000.0,
            (taken - self._performance * u[..., 0]) / 150.0,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.00004, 0.0000001, 0.00004])


class Suction(Sensor):
    """The pressure at which the refrigerant boils in the coil."""

    def __init__(self, state: Space, noise: Sequence[float]) -> None:
        self._indices = state.indices(('coil',))
        self.output = Space(('pressure',), ('Pa',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the pressure."""
        (coil,) = (x[..., k] for k in self._indices)
        return _stack(292800.0 * np.exp(0.034 * coil))


class SoftFinger(Model):
    """A finger of silicone that bends by the pressure of air."""

    state = Space(('bend', 'turn', 'pressure'), ('rad', 'rad/s', 'kPa'))
    input = Space(('valve',), ('',))
    max_step = 0.02

    def __init__(
        self,
        stiffness: Annotated[float, About('of the silicone', '1/s^2', minimum=0.0)] = 40.0,
        hardening: Annotated[float, About('by the cube', '1/s^2', minimum=0.0)] = 4.0,
        damping: Annotated[float, About('decay of the rate', '1/s', minimum=0.0)] = 5.0,
        push: Annotated[float, About('by the pressure', '1/s^2/kPa', minimum=0.0)] = 1.2,
        gain: Annotated[float, About('of the valve', 'kPa/s', minimum=0.0)] = 60.0,
        leak: Annotated[float, About('decay of the pressure', '1/s', minimum=0.0)] = 0.8,
    ) -> None:
        self._stiffness, self._hardening, self._damping = stiffness, hardening, damping
        self._push, self._gain, self._leak = push, gain, leak

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the changes of bend, rate and pressure."""
        bend, turn, pressure = (x[..., k] for k in range(3))
        back = self._stiffness * bend + self._hardening * bend**3 + self._damping * turn
        return _stack(
            turn, self._push * pressure - back, self._gain * u[..., 0] - self._leak * pressure
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.0, 0.3, 2.0])


class Tumbler(Model):
    """The rates of a small satellite, after Euler, with a wheel along z."""

    state = Space(('p', 'q', 'r', 'spin'), ('rad/s',) * 4)
    input = Space(('tx', 'ty', 'tz', 'motor'), ('N m',) * 4)
    max_step = 0.2

    def __init__(
        self,
        inertia_x: Annotated[float, About('about x', 'kg m^2', minimum=1e-6)] = 0.05,
        inertia_y: Annotated[float, About('about y', 'kg m^2', minimum=1e-6)] = 0.06,
        inertia_z: Annotated[float, About('about z', 'kg m^2', minimum=1e-6)] = 0.035,
        rotor: Annotated[float, About('inertia of the wheel', 'kg m^2', minimum=1e-8)] = 0.0003,
        friction: Annotated[float, About('decay of its spin', '1/s', minimum=0.0)] = 0.02,
    ) -> None:
        self._inertias, self._rotor = (inertia_x, inertia_y, inertia_z), rotor
        self._friction = friction

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the changes of the rates and of the spin."""
        (a, b, c), j = self._inertias, self._rotor
        p, q, r, spin = (x[..., k] for k in range(4))
        motor = u[..., 3] - self._friction * j * spin
        return _stack(
            (u[..., 0] + (b - c) * q * r - q * j * spin) / a,
            (u[..., 1] + (c - a) * r * p + p * j * spin) / b,
            (u[..., 2] + (a - b) * p * q - motor) / c,
            motor / j,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.000001, 0.000001, 0.000001, 0.1])
