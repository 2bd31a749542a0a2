# SPDX-License-Identifier: Apache-2.0
"""Ranges and directions of known landmarks from a robot: a lidar, a camera, radio anchors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, brief, variances
from kalman_ros.core import rotations as so3

#: Distance in m below which a direction is undefined.
_NEAREST = 1e-6
_UNITS = {'range': 'm', 'bearing': 'rad', 'elevation': 'rad'}


class Landmarks(Sensor):
    """r = |d|, bearing = atan2(d_y, d_x), elevation = atan2(d_z, |d_x, d_y|), d = R' (l - p).

    One reading contains the numbers of all landmarks l, one landmark after the other (S. Thrun, W.
    Burgard and D. Fox, Probabilistic Robotics, 2005, section 6.6.2).

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviation of each coordinate; or, for all landmarks, of the coordinates of one.
    measures
        The names of the states: x and y, or x, y and z; then the heading, an angle, or the names
        of a rotation. Ranges alone need no heading.
    positions
        The landmarks, two or three numbers each, one after the other, in m.
    reads
        Numbers that are read, out of ``range``, ``bearing`` and, in space, ``elevation``.
    range_offset
        Length by which all ranges are too long, in m.
    bearing_offset
        Angle by which all bearings are too large, in rad.
    """

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[
            Sequence[str], About('names of position, then of heading or rotation')
        ] = ('x', 'y', 'yaw'),
        positions: Annotated[
            Sequence[float], About('landmarks, x and y, or x, y and z, of each', 'm')
        ] = (0.0, 0.0),
        reads: Annotated[Sequence[str], About('which of range, bearing, elevation')] = (
            'range',
            'bearing',
        ),
        range_offset: Annotated[
            float, About('by which all ranges are too long, as those of radio', 'm')
        ] = 0.0,
        bearing_offset: Annotated[
            float,
            About('by which all bearings are too large, as of a camera that is turned', 'rad'),
        ] = 0.0,
    ) -> None:
        self.state = state
        turned = [n for n in measures if n in state.angles or n in sum(state.rotations, ())]
        place = [name for name in measures if name not in turned]
        self._place = state.indices(place, 'measures')
        if len(place) not in (2, 3):
            listed = ', '.join(measures)
            raise ValueError(f'measures: expected 2 or 3 names of the position, got ({listed})')
        self._turn = self._attitude(turned, len(place))
        if len(positions) == 0 or len(positions) % len(place) or not np.isfinite(positions).all():
            raise ValueError(
                f'positions: expected {len(place)} finite numbers for each landmark, '
                f'got {brief(list(positions))}'
            )
        self._landmarks = np.reshape(np.array(positions, dtype=float), (-1, len(place)))
        self._which = Space(tuple(_UNITS)).indices(reads, 'reads')
        if 'elevation' in reads and len(place) == 2:
            raise ValueError('reads: elevation takes a position in space in measures')
        if self._turn is None and {*reads} != {'range'}:
            raise ValueError('reads: a direction takes a heading or a rotation in measures')
        self._offset, self._turned = range_offset, bearing_offset
        self._name(tuple(reads), list(noise))

    def _attitude(self, names: Sequence[str], dimension: int) -> slice | None:
        """Return where the heading or the rotation is in the state; None for ranges alone."""
        if not names:
            return None
        if dimension == 3:
            return self.state.rotation(names)
        if len(names) > 1:
            raise ValueError(f'measures: expected one heading, got ({", ".join(names)})')
        (index,) = self.state.indices(names, 'measures')
        return slice(index, index + 1)

    def _name(self, reads: tuple[str, ...], noise: list[float]) -> None:
        """Set the space and the covariance of a reading."""
        count = len(self._landmarks)
        names = [f'{kind}_{k + 1}' for k in range(count) for kind in reads]
        angles = tuple(name for name in names if not name.startswith('range'))
        self.output = Space(tuple(names), tuple(_UNITS[kind] for kind in reads) * count, angles)
        whole = noise * count if len(noise) == len(reads) else noise
        self.covariance = variances('noise', whole, len(names))

    def measure(self, x: Array) -> Array:
        """Return range and direction of each landmark (..., k)."""
        d = self._landmarks - x[..., np.newaxis, self._place]
        if self._turn is not None:
            d = self._of_body(x[..., np.newaxis, self._turn], d)
        across = np.hypot(d[..., 0], d[..., 1])
        up = d[..., 2] if d.shape[-1] == 3 else np.zeros_like(across)
        readings = np.stack(
            (
                np.maximum(np.hypot(across, up), _NEAREST) + self._offset,
                np.arctan2(d[..., 1], d[..., 0]) + self._turned,
                np.arctan2(up, across),
            ),
            axis=-1,
        )[..., self._which]
        return np.asarray(readings.reshape(*x.shape[:-1], self.output.size))

    @staticmethod
    def _of_body(turn: Array, d: Array) -> Array:
        """Return vectors (..., k, 2 or 3) of the world in the axes of the body."""
        if d.shape[-1] == 3:
            return so3.rotate_back(np.broadcast_to(turn, d.shape), d)
        c, s = np.cos(turn[..., 0]), np.sin(turn[..., 0])
        return np.stack((c * d[..., 0] + s * d[..., 1], c * d[..., 1] - s * d[..., 0]), axis=-1)


SENSOR = Landmarks
