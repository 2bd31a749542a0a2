# SPDX-License-Identifier: Apache-2.0
"""A barometer in air, with readings in Pa."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, variances

#: Lapse rate in K/m, temperature at sea level in K, and exponent g M / (R L): ISO 2533:1975,
#: Standard Atmosphere, for heights up to 11 km.
_LAPSE, _TEMPERATURE, _EXPONENT = 0.0065, 288.15, 5.255876
#: Share of the temperature at sea level that is left at 11 km, the end of the formula.
_LEAST = 0.75


class Barometer(Sensor):
    """p = p_0 (1 - L (z + z_0) / T)^5.256, with z_0 the height of the origin.

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviation of the reading, in Pa; 12 Pa are a metre.
    measures
        The name of the state that is the height.
    sea_level_pressure, altitude
        p_0 in Pa, and z_0 in m: one of the two can be chosen so that the reading at the origin is
        right.
    """

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[str, About('name of the state that is the height')] = 'z',
        sea_level_pressure: Annotated[
            float, About('pressure at sea level', 'Pa', minimum=1.0)
        ] = 101325.0,
        altitude: Annotated[float, About('height of the origin above sea level', 'm')] = 0.0,
    ) -> None:
        (self._height,) = state.indices([measures], 'measures')
        self.output = Space(('pressure',), ('Pa',))
        self.covariance = variances('noise', noise, 1)
        self._sea_level, self._altitude = sea_level_pressure, altitude

    def measure(self, x: Array) -> Array:
        """Return the pressure at the height of ``x``."""
        height = x[..., self._height, np.newaxis] + self._altitude
        share = np.maximum(1.0 - _LAPSE / _TEMPERATURE * height, _LEAST)
        return np.asarray(self._sea_level * share**_EXPONENT)


SENSOR = Barometer
