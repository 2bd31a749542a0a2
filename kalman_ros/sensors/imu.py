# SPDX-License-Identifier: Apache-2.0
"""An inertial measurement unit: angular rate and specific force, gravity included."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, variances
from kalman_ros.core import rotations as so3


class Imu(Sensor):
    """y = (w, a + R' (0, 0, g)), in the axes of the body.

    At rest it reads g upwards, by which it sees roll and pitch (P. Groves, Principles of GNSS,
    Inertial, and Multisensor Integrated Navigation Systems, 2013, section 2.4.7).

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviations of the angular rates, in rad/s, and of the three specific forces, in
        m/s^2.
    measures
        The names of the states: the rotation, any number of angular rates, which may be none, and
        the acceleration of the body.
    gravity
        Acceleration of gravity in m/s^2; 0 for an IMU that has removed it.
    """

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[
            Sequence[str], About('names of the rotation, of angular rates, of the acceleration')
        ] = ('rx', 'ry', 'rz', 'wx', 'wy', 'wz', 'ax', 'ay', 'az'),
        gravity: Annotated[
            float, About('acceleration of gravity', 'm/s^2', minimum=0.0)
        ] = 9.80665,
    ) -> None:
        self.state, self._turn = state, state.rotation(measures[:3])
        self._read = np.array(state.indices(measures[3:], 'measures'), dtype=np.intp)
        if len(self._read) < 3:
            expected = 'expected a rotation, any angular rates, and 3 accelerations'
            raise ValueError(f'measures: {expected}, got ({", ".join(measures)})')
        self._gravity = np.array([0.0, 0.0, gravity])
        rates = tuple(measures[3:-3])
        self.output = Space((*rates, 'fx', 'fy', 'fz'), ('rad/s',) * len(rates) + ('m/s^2',) * 3)
        self.covariance = variances('noise', noise, self.output.size)
        self._selected = np.eye(state.size)[self._read]

    def measure(self, x: Array) -> Array:
        """Return angular rates and specific force."""
        y: Array = x[..., self._read]
        y[..., -3:] += so3.rotate_back(x[..., self._turn], self._gravity)
        return y

    def jacobian(self, x: Array) -> Array:
        """Return the rows of the identity, and R' [g]x in the columns of the rotation."""
        H = np.zeros((*x.shape[:-1], *self._selected.shape)) + self._selected
        H[..., -3:, self._turn] += so3.exp(-x[..., self._turn]) @ so3.skew(self._gravity)
        return H


SENSOR = Imu
