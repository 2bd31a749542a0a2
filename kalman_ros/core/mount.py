# SPDX-License-Identifier: Apache-2.0
"""Mounting of a sensor on its body, and the axes of its readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kalman_ros.linear.matrices import Array

from . import rotations as so3

#: Axes of the world: east, north, up (REP-103) or north, east, down; those of the body go with
#: them: forward, left, up or forward, right, down.
CONVENTIONS = ('enu', 'ned')
#: Rotation that is its own inverse.
_ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FLU_FROM_FRD = np.diag([1.0, -1.0, -1.0])


class Mounting(NamedTuple):
    """Rotation of a sensor against its body, and the frame of its messages.

    Parameters
    ----------
    rotation
        Roll, pitch and yaw of the sensor in the axes of the body, in rad, as in a transform from
        the frame of the body to that of the sensor.
    convention
        One of `CONVENTIONS`.
    frame
        Frame of the messages; '' for the frame of the first message.
    placed
        Whether place or rotation of the sensor is configured.
    from_tf
        Whether place and rotation are taken from transforms, and are not known yet.
    heading
        Heading, in rad counter-clockwise from east, that the messages call zero: the declination
        of a compass, or the offset of a gyro that starts anywhere.
    place
        Place of a sensor whose readings are the input: forward, left and up of the centre of the
        body, in m.
    scale
        True values of the input by those of its readings, by field; 1 where it is empty.
    """

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    convention: str = 'enu'
    frame: str = ''
    placed: bool = False
    from_tf: bool = False
    heading: float = 0.0
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: tuple[float, ...] = ()

    @property
    def turned(self) -> bool:
        """Whether the axes differ from those of the body and the world."""
        return any(self.rotation) or self.convention != 'enu' or self.heading != 0.0

    def at(self, place: Sequence[float]) -> Mounting:
        """Return the mounting of a sensor, whose readings are the input, at a ``place`` (3,)."""
        x, y, z = map(float, place)
        return self._replace(place=(x, y, z))

    @property
    def body_from_sensor(self) -> Array:
        """Rotation (3, 3) of vectors from the axes of the sensor to those of the body."""
        R = so3.exp(so3.from_euler(np.array(self.rotation)))
        return np.asarray(R @ _FLU_FROM_FRD if self.convention == 'ned' else R)

    @property
    def world_from_reported(self) -> Array:
        """Rotation (3, 3) of places from the axes of the messages to east, north, up."""
        R = so3.exp(np.array([0.0, 0.0, self.heading]))
        return np.asarray(R @ _ENU_FROM_NED if self.convention == 'ned' else R)


#: Mounting along the axes of the body, with the frame of the first message.
STRAIGHT = Mounting()


def mounting(
    rotation: Sequence[float],
    convention: str,
    frame: str,
    translation: Sequence[float],
    from_tf: bool = False,
    heading: float = 0.0,
) -> Mounting:
    """Return the mounting by the options of a sensor.

    Raises
    ------
    ValueError
        If an option is wrong; the message names it.
    """
    if len(rotation) != 3 or not np.isfinite(rotation).all():
        got = ', '.join(f'{angle:g}' for angle in rotation)
        raise ValueError(f'mount.rotation: expected roll, pitch and yaw in rad, got ({got})')
    if convention not in CONVENTIONS:
        raise ValueError(f"convention: expected {' or '.join(CONVENTIONS)}, got '{convention}'")
    if frame.startswith('/'):
        raise ValueError(f"frame: expected a name without a leading slash, got '{frame}'")
    if len(translation) != 3 or not np.isfinite(translation).all():
        got = ', '.join(f'{length:g}' for length in translation)
        raise ValueError(f'mount.translation: expected forward, left and up in m, got ({got})')
    roll, pitch, yaw = map(float, rotation)
    placed = any(rotation) or any(translation)
    if placed and from_tf:
        raise ValueError('mount.tf: expected no mount.translation and mount.rotation beside it')
    return Mounting((roll, pitch, yaw), convention, frame, placed or from_tf, from_tf, heading)
