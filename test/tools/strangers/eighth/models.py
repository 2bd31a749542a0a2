# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the eighth set of systems have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances

from ..sixth.models import _stack

_GRAVITY = 9.80665


class Ebike(Model):
    """An electric bicycle on hilly roads, pushed by what its crank measures."""

    state = Space(('v', 'slope', 'z', 'push'), ('m/s', '1', 'm', 'N'))
    input = Space(('drive',), ('N',))
    max_step = 0.05

    def __init__(
        self,
        mass: Annotated[float, About('with the rider', 'kg', minimum=1.0)] = 100.0,
        area: Annotated[float, About('drag area', 'm^2', minimum=0.0)] = 0.5,
        rolling: Annotated[float, About('resistance of the tyres by weight', minimum=0.0)] = 0.008,
    ) -> None:
        self._mass, self._area, self._rolling = mass, area, rolling

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the acceleration, and the changes of road and push."""
        v, slope, push = x[..., 0], x[..., 1], x[..., 3]
        air = 0.6 * self._area * v * np.abs(v) / self._mass
        return _stack(
            push / self._mass - air - _GRAVITY * (self._rolling + slope),
            -slope / 30.0,
            v * slope,
            (u[..., 0] - push) / 0.25,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of speed, slope and push."""
        return np.diag([0.01, 0.00005, 0.0, 20.0])


class Along(Sensor):
    """An accelerometer along an electric bicycle, which feels all forces but its weight."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        mass: Annotated[float, About('with the rider', 'kg', minimum=1.0)] = 100.0,
        area: Annotated[float, About('drag area', 'm^2', minimum=0.0)] = 0.5,
        rolling: Annotated[float, About('resistance of the tyres by weight', minimum=0.0)] = 0.008,
    ) -> None:
        self._indices = state.indices(('v', 'push'))
        self._mass, self._area, self._rolling = mass, area, rolling
        self.output = Space(('along',), ('m/s^2',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the specific force."""
        v, push = (x[..., k] for k in self._indices)
        air = 0.6 * self._area * v * np.abs(v)
        return _stack((push - air) / self._mass - _GRAVITY * self._rolling)


class Reactor(Model):
    """A stirred reactor with a cooled jacket, in which a feed reacts and gives off heat."""

    state = Space(('inside', 'jacket', 'feedstock'), ('degC', 'degC', 'mol/l'))
    input = Space(('coolant', 'feed'), ('degC', '1/s'))
    max_step = 1.0

    def __init__(
        self,
        rate: Annotated[float, About('of the reaction at 60 degC', '1/s', minimum=0.0)] = 0.01,
        heat: Annotated[float, About('warming by a mole in a litre', 'K l/mol')] = 15.0,
        transfer: Annotated[float, About('through the wall', '1/s', minimum=0.0)] = 0.02,
        feed_temperature: Annotated[float, About('of the feed', 'degC')] = 20.0,
    ) -> None:
        self._speed, self._heat, self._transfer = rate, heat, transfer
        self._feed_temperature = feed_temperature

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the balances of heat and of the feedstock."""
        inside, jacket, feedstock = (x[..., k] for k in range(3))
        coolant, feed = u[..., 0], u[..., 1]
        gone = self._speed * np.exp(0.05 * (inside - 60.0)) * feedstock
        return _stack(
            feed * (self._feed_temperature - inside)
            + self._heat * gone
            + self._transfer * (jacket - inside),
            (coolant - jacket) / 20.0 + 0.5 * self._transfer * (inside - jacket),
            feed * (2.0 - feedstock) - gone,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities of both temperatures and of the feedstock."""
        return np.diag([0.002, 0.002, 2e-6])
