# SPDX-License-Identifier: Apache-2.0
"""Roll, pitch and yaw, or some of them: a compass, an inclinometer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, variances
from kalman_ros.core import rotations as so3

_ANGLES = ('roll', 'pitch', 'yaw')
#: With a pitch this close to a right angle, in rad, roll and yaw are the same.
_NEAREST = 1e-6


class Euler(Sensor):
    """y = some of roll, pitch and yaw of a rotation, about fixed axes x, y and z (REP-103).

    A whole orientation is better measured as a rotation, which has no singular pitch: `states`.

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviations of the angles, in rad.
    measures
        The names of the three states that are the rotation.
    angles
        Angles that are read, out of ``roll``, ``pitch`` and ``yaw``.
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
        angles: Annotated[Sequence[str], About('which of roll, pitch and yaw')] = ('yaw',),
    ) -> None:
        self.state, self._turn = state, state.rotation(measures)
        self._which = Space(_ANGLES).indices(angles, 'angles')
        self.output = Space(tuple(angles), ('rad',) * len(self._which), angles=tuple(angles))
        self.covariance = variances('noise', noise, len(self._which))

    def measure(self, x: Array) -> Array:
        """Return the angles."""
        return np.asarray(so3.to_euler(x[..., self._turn])[..., self._which])

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives by a turn about the axes of the world.

        J. Diebel, Representing Attitude (2006), equation 79, for the axes of the world.
        """
        _, pitch, yaw = np.moveaxis(so3.to_euler(x[..., self._turn]), -1, 0)
        c, s, o = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
        cosine, t = np.maximum(np.cos(pitch), _NEAREST), np.sin(pitch)
        E = np.array(
            [[c / cosine, s / cosine, o], [-s, c, o], [c * t / cosine, s * t / cosine, o + 1.0]]
        )
        H = np.zeros((*x.shape[:-1], len(self._which), x.shape[-1]))
        H[..., self._turn] = np.moveaxis(E[self._which], (0, 1), (-2, -1))
        return H


SENSOR = Euler
