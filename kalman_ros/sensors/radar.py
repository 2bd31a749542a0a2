# SPDX-License-Identifier: Apache-2.0
"""A radar at the origin: range, bearing and range rate of a target in the plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, coordinates, variances

#: Distance in m below which a bearing is undefined.
_NEAREST = 1e-6


class Radar(Sensor):
    """r = |p|, phi = atan2(p_y, p_x), r' = p . v / r.

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviations of range, bearing and range rate, in m, rad and m/s.
    measures
        The names of the states that are the position and the velocity: x, y, and either two
        components of the velocity, or a speed and its heading, which is an angle of the state.
    """

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[
            Sequence[str],
            About('names of position and velocity: x, y, and v_x, v_y or speed and heading'),
        ] = ('x', 'y', 'v_x', 'v_y'),
    ) -> None:
        self._indices = np.array(state.indices(measures, 'measures'), dtype=np.intp)
        if len(self._indices) != 4:
            raise ValueError(f'measures: expected 4 names, got {len(self._indices)}')
        self._by_heading = measures[3] in state.angles
        self._select = np.eye(state.size)[self._indices]
        self.output = Space(
            ('range', 'bearing', 'range_rate'), ('m', 'rad', 'm/s'), angles=('bearing',)
        )
        self.covariance = variances('noise', noise, 3)

    def measure(self, x: Array) -> Array:
        """Return range, bearing and range rate."""
        px, py, vx, vy = self._motion(x)
        r = np.maximum(np.hypot(px, py), _NEAREST)
        return np.stack((r, np.arctan2(py, px), (px * vx + py * vy) / r), axis=-1)

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives by position and velocity, times the derivatives of these."""
        px, py, vx, vy = self._motion(x)
        r = np.maximum(np.hypot(px, py), _NEAREST)
        cross = (vx * py - vy * px) / r**3
        zero = np.zeros_like(r)
        H = np.array(
            [
                [px / r, py / r, zero, zero],
                [-py / r**2, px / r**2, zero, zero],
                [py * cross, -px * cross, px / r, py / r],
            ]
        )
        return np.asarray(np.moveaxis(H, (0, 1), (-2, -1)) @ self._turned(x) @ self._select)

    def _motion(self, x: Array) -> tuple[Array, ...]:
        """Return position and velocity, each (...,)."""
        px, py, a, b = coordinates(x.take(self._indices, -1))
        if self._by_heading:
            return px, py, a * np.cos(b), a * np.sin(b)
        return px, py, a, b

    def _turned(self, x: Array) -> Array:
        """Return the derivative (..., 4, 4) of position and velocity by the measured states."""
        turned = np.eye(4)
        if self._by_heading:
            speed, heading = coordinates(x[..., self._indices[2:]])
            c, s = np.cos(heading), np.sin(heading)
            turned = np.broadcast_to(turned, (*speed.shape, 4, 4)).copy()
            part = np.array([[c, -speed * s], [s, speed * c]])
            turned[..., 2:, 2:] = np.moveaxis(part, (0, 1), (-2, -1))
        return turned


SENSOR = Radar
