# SPDX-License-Identifier: Apache-2.0
"""A pressure gauge under water, with readings in Pa."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, variances


class Pressure(Sensor):
    """p = p_0 - rho g z, with z the height above the surface, negative under it.

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviation of the reading, in Pa.
    measures
        The name of the state that is the height.
    surface_pressure, density, gravity
        p_0 in Pa, rho in kg/m^3, g in m/s^2.
    """

    linear = True

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[str, About('name of the state that is the height')] = 'z',
        surface_pressure: Annotated[float, About('pressure at the surface', 'Pa')] = 101325.0,
        density: Annotated[float, About('density of the water', 'kg/m^3', minimum=1e-9)] = 1025.0,
        gravity: Annotated[float, About('acceleration of gravity', 'm/s^2')] = 9.80665,
    ) -> None:
        (height,) = state.indices([measures], 'measures')
        self.output = Space(('pressure',), ('Pa',))
        self.covariance = variances('noise', noise, 1)
        self._surface = surface_pressure
        self._jacobian = np.zeros((1, state.size))
        self._jacobian[0, height] = -density * gravity

    def measure(self, x: Array) -> Array:
        """Return the pressure at the depth of ``x``."""
        return np.asarray(self._surface + x.dot(self._jacobian.T))

    def jacobian(self, x: Array) -> Array:
        """Return -rho g in the column of the height."""
        return self._jacobian


SENSOR = Pressure
