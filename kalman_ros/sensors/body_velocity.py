# SPDX-License-Identifier: Apache-2.0
"""Velocity along the axes of the body, from a state in those of the world: wheels, no slip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, variances
from kalman_ros.core import rotations as so3

#: The names of the readings, since the states of the same letters are along other axes.
_NAMES = ('forward', 'left', 'up')


class BodyVelocity(Sensor):
    """y = some of the rows of R' v: forward, to the left, up.

    Wheels that do not slip read 0 to the left and up.

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviation of each coordinate, in m/s.
    measures
        The names of the states: the rotation, then the velocity in the axes of the world.
    axes
        Axes that are read, out of ``x``, ``y`` and ``z``.
    """

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[
            Sequence[str], About('names of the rotation, and of the velocity in the world')
        ] = ('rx', 'ry', 'rz', 'vx', 'vy', 'vz'),
        axes: Annotated[Sequence[str], About('which of x, y and z of the body')] = ('x', 'y', 'z'),
    ) -> None:
        self.state = state
        self._turn = state.rotation(measures[:3])
        self._velocity = state.indices(measures[3:], 'measures')
        if len(self._velocity) != 3:
            raise ValueError(f'measures: expected 6 names, got {len(measures)}')
        self._which = Space(('x', 'y', 'z')).indices(axes, 'axes')
        names = tuple(_NAMES[index] for index in self._which)
        self.output = Space(names, ('m/s',) * len(names))
        self.covariance = variances('noise', noise, len(self._which))

    def measure(self, x: Array) -> Array:
        """Return the velocity in the axes of the body."""
        return so3.rotate_back(x[..., self._turn], x[..., self._velocity])[..., self._which]

    def jacobian(self, x: Array) -> Array:
        """Return R' [v]x in the columns of the rotation, and R' in those of the velocity."""
        Rt = so3.exp(-x[..., self._turn])[..., self._which, :]
        H = np.zeros((*Rt.shape[:-1], x.shape[-1]))
        H[..., self._turn] = Rt @ so3.skew(x[..., self._velocity])
        H[..., self._velocity] = Rt
        return H


SENSOR = BodyVelocity
