# SPDX-License-Identifier: Apache-2.0
"""A sensor of any linear combination of the states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, matrix, variances


class Linear(Sensor):
    """y = C x.

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviation of each coordinate of y.
    C
        The measurement matrix (k, n), row by row; one row per value of ``noise``.
    names
        Names of the coordinates of y; numbered if missing.
    """

    linear = True

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        C: Annotated[Sequence[float], About('measurement matrix, row by row')] = (1.0,),
        names: Annotated[Sequence[str], About('names of the measured coordinates')] = ('',),
    ) -> None:
        k = len(noise)
        listed = [name for name in names if name]
        labels = listed if len(listed) == k else [f'y{index}' for index in range(k)]
        self.covariance = variances('noise', noise, k)
        self._C = np.asfortranarray(matrix('C', np.array(C), (k, state.size)))
        self.output = Space(tuple(labels), tuple(_unit(state, row) for row in self._C))

    def measure(self, x: Array) -> Array:
        """Return C x."""
        return np.asarray(x.dot(self._C.T))

    def jacobian(self, x: Array) -> Array:
        """Return C."""
        return self._C


def _unit(state: Space, row: Array) -> str:
    """Return the unit of a sum or difference of states; '' for other combinations."""
    units = {unit for unit, factor in zip(state.units, row) if factor}
    return units.pop() if len(units) == 1 and {*np.abs(row)} <= {0.0, 1.0} else ''


SENSOR = Linear
