# SPDX-License-Identifier: Apache-2.0
"""A magnetometer: the field of the Earth in the axes of the body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, variances, vector
from kalman_ros.core import rotations as so3


class Magnetometer(Sensor):
    """y = R' m, with m the field in the axes of the world.

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviations along the three axes, in T.
    measures
        The names of the three states that are the rotation.
    field
        Field m of the Earth in T: east, north and up. Its direction over the ground is the
        declination.
    """

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[Sequence[str], About('names of the states of the rotation')] = (
            'rx',
            'ry',
            'rz',
        ),
        field: Annotated[Sequence[float], About('field of the Earth: east, north, up', 'T')] = (
            1.2e-6,
            2.0e-5,
            -4.5e-5,
        ),
    ) -> None:
        self.state, self._turn = state, state.rotation(measures)
        self._field = vector('field', field, 3)
        if not self._field.any():
            raise ValueError('field: expected a field other than zero')
        self.output = Space(('mx', 'my', 'mz'), ('T',) * 3)
        self.covariance = variances('noise', noise, 3)

    def measure(self, x: Array) -> Array:
        """Return the field in the axes of the body."""
        return so3.rotate_back(x[..., self._turn], self._field)

    def jacobian(self, x: Array) -> Array:
        """Return R' [m]x in the columns of the rotation."""
        H = np.zeros((*x.shape[:-1], 3, x.shape[-1]))
        H[..., self._turn] = so3.exp(-x[..., self._turn]) @ so3.skew(self._field)
        return H


SENSOR = Magnetometer
