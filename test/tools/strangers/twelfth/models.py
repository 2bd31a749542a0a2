# SPDX-License-Identifier: Apache-2.0
"""Models that the owners of the twelfth set of systems have written for the package.

They belong to the parameter files; the simulators do not import them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Sensor, Space, variances

from ..sixth.models import _stack


class QuadTank(Model):
    """Four tanks and two pumps, after Johansson; the upper ones run into the lower ones."""

    state = Space(('first', 'second', 'third', 'fourth'), ('cm',) * 4)
    input = Space(('pump_1', 'pump_2'), ('cm^3/s',) * 2)
    max_step = 1.0

    def __init__(
        self,
        outlet_1: Annotated[float, About('hole of the first', 'cm^2', minimum=0.0)] = 0.1,
        outlet_2: Annotated[float, About('hole of the second', 'cm^2', minimum=0.0)] = 0.09,
        outlet_3: Annotated[float, About('hole of the third', 'cm^2', minimum=0.0)] = 0.07,
        outlet_4: Annotated[float, About('hole of the fourth', 'cm^2', minimum=0.0)] = 0.07,
        split_1: Annotated[float, About('share of pump 1 to the first', minimum=0.0)] = 0.65,
        split_2: Annotated[float, About('share of pump 2 to the second', minimum=0.0)] = 0.6,
    ) -> None:
        self._holes = np.array([outlet_1, outlet_2, outlet_3, outlet_4]) * np.sqrt(2.0 * 981.0)
        self._splits = split_1, split_2

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the changes of the levels."""
        one, two, three, four = np.moveaxis(self._holes * np.sqrt(np.maximum(x, 0.01)), -1, 0)
        (a, b), first, second = self._splits, u[..., 0], u[..., 1]
        return _stack(
            (three + a * first - one) / 28.0,
            (four + b * second - two) / 32.0,
            ((1.0 - b) * second - three) / 28.0,
            ((1.0 - a) * first - four) / 32.0,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.0008, 0.0008, 0.0004, 0.0004])


class SolarHeater(Model):
    """A collector on a roof and a store with two layers."""

    state = Space(('collector', 'top', 'bottom'), ('degC',) * 3)
    input = Space(('sun', 'pump', 'outside'), ('W/m^2', '', 'degC'))
    max_step = 20.0

    def __init__(
        self,
        glass: Annotated[float, About('share of the sun that heats', minimum=0.0)] = 0.75,
        roof: Annotated[float, About('loss of the collector', 'W/K', minimum=0.0)] = 18.0,
        loss: Annotated[float, About('loss of each layer', 'W/K', minimum=0.0)] = 12.0,
        mixing: Annotated[float, About('between the layers', 'W/K', minimum=0.0)] = 15.0,
        heat: Annotated[float, About('that the pump moves', 'W/K', minimum=0.0)] = 180.0,
    ) -> None:
        self._glass, self._roof, self._loss = 4.0 * glass, roof, loss
        self._mixing, self._heat = mixing, heat

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the changes of the temperatures."""
        collector, top, bottom = (x[..., k] for k in range(3))
        moved, mixed = self._heat * u[..., 1], self._mixing * (top - bottom)
        gain = self._glass * u[..., 0] - self._roof * (collector - u[..., 2])
        return _stack(
            (gain - moved * (collector - bottom)) / 20000.0,
            (moved * (collector - top) - mixed - self._loss * (top - 18.0)) / 150000.0,
            (moved * (top - bottom) + mixed - self._loss * (bottom - 18.0)) / 150000.0,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.0004, 0.00002, 0.00002])


class Dialysis(Model):
    """Urea in blood and cells, and the volume of what is outside the cells."""

    state = Space(('blood', 'cells', 'volume'), ('mmol/l', 'mmol/l', 'l'))
    input = Space(('clearance', 'loss'), ('l/s', 'l/s'))
    max_step = 20.0

    def __init__(
        self,
        membranes: Annotated[float, About('between cells and blood', 'l/s', minimum=0.0)] = 0.01,
        growth: Annotated[float, About('made by the body', 'mmol/s', minimum=0.0)] = 0.006,
        refills: Annotated[float, About('return of water', '1/s', minimum=0.0)] = 0.0001,
    ) -> None:
        self._membranes, self._growth, self._refills = membranes, growth, refills

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the changes by machine, membranes and body."""
        blood, cells, volume = (x[..., k] for k in range(3))
        through = self._membranes * (cells - blood)
        dried = u[..., 1] - self._refills * (15.0 - volume)
        return _stack(
            (through - u[..., 0] * blood + dried * blood) / volume,
            (self._growth - through) / 25.0,
            -dried,
        )

    def noise_density(self, x: Array) -> Array:
        """Return the spectral densities."""
        return np.diag([0.000003, 0.000001, 0.00000002])


class Haematocrit(Sensor):
    """The share of red cells, which stay while water leaves."""

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        red: Annotated[float, About('share times volume', 'l', minimum=0.0)] = 4.5,
    ) -> None:
        self._indices, self._red = state.indices(('volume',)), red
        self.output = Space(('share',), ('',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x: Array) -> Array:
        """Return the share."""
        (volume,) = (x[..., k] for k in self._indices)
        return _stack(self._red / volume)
