# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the tenth set of systems have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances

from ..sixth.models import _stack


class Furuta(Model):
    """A pendulum at the end of an arm that turns about the vertical; ``alpha`` is 0 below."""

    state = Space(('theta', 'alpha', 'turn', 'swing'), ('rad', 'rad', 'rad/s', 'rad/s'))
    input = Space(('torque',), ('N m',))
    max_step = 0.01

    def __init__(
        self,
        mass: Annotated[float, About('of the pendulum', 'kg', minimum=1e-6)] = 0.12,
        length: Annotated[float, About('from hinge to centre', 'm', minimum=1e-3)] = 0.15,
        arm: Annotated[float, About('length of the arm', 'm', minimum=1e-3)] = 0.2,
        inertia: Annotated[float, About('of the arm', 'kg m^2', minimum=1e-9)] = 0.003,
        friction: Annotated[float, About('of the arm', 'N m s', minimum=0.0)] = 0.004,
        damping: Annotated[float, About('of the hinge', 'N m s', minimum=0.0)] = 0.0006,
    ) -> None:
        self._weight = mass * length * 9.80665
        self._coupling = mass * arm * length
        self._hinge = mass * (length**2 + 0.0075)
        about = mass / 6000.0  # of the pendulum about its own axis
        self._tilting = self._hinge - about
        self._turning = inertia + mass * arm**2 + about
        self._friction, self._damping = friction, damping

    def _inverse(self, alpha: Array) -> tuple[Array, Array, Array]:
        """Return the three different entries of the inverse of the matrix of masses."""
        first = self._turning + self._tilting * np.sin(alpha) ** 2
        mixed = self._coupling * np.cos(alpha)
        whole = first * self._hinge - mixed**2
        return self._hinge / whole, -mixed / whole, first / whole

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the rates, and the accelerations by Lagrange's equations."""
        alpha, turn, swing = x[..., 1], x[..., 2], x[..., 3]
        s, c = np.sin(alpha), np.cos(alpha)
        about = u[..., 0] - self._friction * turn + self._coupling * s * swing**2
        about = about - 2.0 * self._tilting * s * c * turn * swing
        across = self._tilting * s * c * turn**2 - self._weight * s - self._damping * swing
        a, b, d = self._inverse(alpha)
        return _stack(turn, swing, a * about + b * across, b * about + d * across)

    def noise_density(self, x: Array) -> Array:
        """Return the density of the rates by random torques at both hinges."""
        a, b, d = self._inverse(x[..., 1])
        first, second = 2e-6, 2e-7
        density = np.zeros((*x.shape, 4))
        density[..., 2, 2] = a * a * first + b * b * second
        density[..., 2, 3] = density[..., 3, 2] = a * b * first + b * d * second
        density[..., 3, 3] = b * b * first + d * d * second
        return density


class Fermenter(Model):
    """Yeast that grows on sugar in a vessel of 2 l, with air by a stirrer."""

    state = Space(('cells', 'sugar', 'oxygen'), ('g/l', 'g/l', '%'))
    input = Space(('feed', 'stirrer'), ('ml/s', ''))
    max_step = 20.0

    def __init__(
        self,
        growth: Annotated[float, About('fastest growth', '1/s', minimum=0.0)] = 1.2e-4,
        half: Annotated[float, About('sugar at half of it', 'g/l', minimum=1e-3)] = 0.3,
        gain: Annotated[float, About('cells by sugar', minimum=1e-3)] = 0.5,
        strength: Annotated[float, About('sugar in the feed', 'g/l', minimum=0.0)] = 50.0,
        air: Annotated[float, About('renewal by stirrer', '1/s', minimum=0.0)] = 0.02,
        breath: Annotated[float, About('oxygen by new cells', '% l/g', minimum=0.0)] = 1400.0,
    ) -> None:
        self._growth, self._half, self._gain = growth, half, gain
        self._strength, self._air, self._breath = strength, air, breath

    def derivative(self, x: Array, u: Array) -> Array:
        """Return growth, feed and breath."""
        cells, sugar, oxygen = x[..., 0], np.maximum(x[..., 1], 0.0), x[..., 2]
        new = self._growth * cells * sugar / (self._half + sugar)
        fed = u[..., 0] / 2000.0
        return _stack(
            new - fed * cells,
            fed * (self._strength - x[..., 1]) - new / self._gain,
            self._air * u[..., 1] * (100.0 - oxygen) - self._breath * new,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([4e-7, 4e-7, 0.02])


class Exhaust(Sensor):
    """What yeast breathes out, by how fast it grows."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        growth: Annotated[float, About('fastest growth', '1/s', minimum=0.0)] = 1.2e-4,
        half: Annotated[float, About('sugar at half of it', 'g/l', minimum=1e-3)] = 0.3,
        share: Annotated[float, About('gas by growth', '% l s/g')] = 2000.0,
    ) -> None:
        self._indices = state.indices(('cells', 'sugar'))
        self._growth, self._half, self._share = growth, half, share
        self.output = Space(('gas',), ('%',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the share of carbon dioxide."""
        cells, sugar = (x[..., k] for k in self._indices)
        sugar = np.maximum(sugar, 0.0)
        return _stack(self._share * self._growth * cells * sugar / (self._half + sugar))
