# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the ninth set of systems have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances

from ..sixth.models import _stack


class Loader(Model):
    """A wheel loader that is steered by the joint between its halves; the place is in front."""

    state = Space(
        ('x', 'y', 'psi', 'v', 'joint', 'rate'),
        ('m', 'm', 'rad', 'm/s', 'rad', 'rad/s'),
        angles=('psi', 'joint'),
    )
    input = Space(('speed', 'steer'), ('m/s', 'rad/s'))
    max_step = 0.05

    def __init__(
        self,
        front: Annotated[float, About('from the front axle to the joint', 'm', minimum=0.1)] = 1.5,
        rear: Annotated[float, About('from the joint to the rear axle', 'm', minimum=0.1)] = 1.5,
        valve: Annotated[float, About('time constant of the joint', 's', minimum=0.05)] = 0.3,
    ) -> None:
        self._front, self._rear, self._valve = front, rear, valve

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the motion of the front half, and the approach to the commands."""
        psi, v, joint, rate = (x[..., k] for k in range(2, 6))
        turn = (v * np.sin(joint) + self._rear * rate) / (self._front * np.cos(joint) + self._rear)
        return _stack(
            v * np.cos(psi),
            v * np.sin(psi),
            turn,
            (u[..., 0] - v) / 0.8,
            rate,
            (u[..., 1] - rate) / self._valve,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of the speed and of the rate of the joint."""
        return np.diag([0.0, 0.0, 0.0, 0.01, 0.0, 0.0005])


class FrontTurn(Sensor):
    """A gyro on the front half of a wheel loader."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        front: Annotated[float, About('from the front axle to the joint', 'm', minimum=0.1)] = 1.5,
        rear: Annotated[float, About('from the joint to the rear axle', 'm', minimum=0.1)] = 1.5,
    ) -> None:
        self._indices = state.indices(('v', 'joint', 'rate'))
        self._front, self._rear = front, rear
        self.output = Space(('turn',), ('rad/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the turn rate."""
        v, joint, rate = (x[..., k] for k in self._indices)
        return _stack(
            (v * np.sin(joint) + self._rear * rate) / (self._front * np.cos(joint) + self._rear)
        )


class HotAir(Model):
    """A hot-air balloon; ``warmth`` is by how much the air inside is warmer than outside."""

    state = Space(('z', 'climb', 'warmth'), ('m', 'm/s', 'K'))
    input = Space(('burner',), ('',))
    max_step = 0.2

    def __init__(
        self,
        level: Annotated[float, About('warmth at which it floats', 'K')] = 70.0,
        lift: Annotated[float, About('acceleration by warmth', 'm/s^2/K')] = 0.03,
        drag: Annotated[float, About('by the square of the speed', '1/m', minimum=0.0)] = 0.04,
        burner: Annotated[float, About('warming by a full flame', 'K/s')] = 1.5,
        loss: Annotated[float, About('time in which it cools', 's', minimum=1.0)] = 120.0,
    ) -> None:
        self._level, self._lift, self._drag = level, lift, drag
        self._burner, self._loss = burner, loss

    def derivative(self, x: Array, u: Array) -> Array:
        """Return climb, lift less drag, and flame less losses."""
        climb, warmth = x[..., 1], x[..., 2]
        return _stack(
            climb,
            self._lift * (warmth - self._level) - self._drag * climb * np.abs(climb),
            self._burner * u[..., 0] - warmth / self._loss,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of gusts and of the flame."""
        return np.diag([0.0, 0.004, 0.04])


class Crown(Sensor):
    """The temperature at the top of a hot-air balloon, in air that is colder above."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        ground: Annotated[float, About('temperature of the air at sea level', 'degC')] = 18.0,
        lapse: Annotated[float, About('by which it falls with the height', 'K/m')] = 0.0065,
    ) -> None:
        self._indices = state.indices(('z', 'warmth'))
        self._ground, self._lapse = ground, lapse
        self.output = Space(('temperature',), ('degC',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the temperature."""
        z, warmth = (x[..., k] for k in self._indices)
        return _stack(warmth + self._ground - self._lapse * z)


class Wakefulness(Sensor):
    """A monitor of the brain waves of a patient, by the drug where it acts."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        top: Annotated[float, About('reading without a drug', minimum=1.0)] = 95.0,
        half: Annotated[float, About('drug with half of the effect', 'mg/l', minimum=0.1)] = 3.4,
    ) -> None:
        (self._index,) = state.indices(('brain',))
        self._top, self._half = top, half
        self.output = Space(('index',), ('',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the index."""
        share = np.maximum(x[..., self._index], 0.0) / self._half
        return _stack(self._top / (1.0 + share**2))
