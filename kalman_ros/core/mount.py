# SPDX-License-Identifier: Apache-2.0
"""How a sensor sits on its body, and in which axes it reads."""

from __future__ import annotations

from collections.abc import Sequence
from math import asin, atan2, copysign, cos, hypot, pi, sin
from typing import NamedTuple

import numpy as np

from kalman_ros.linear.matrices import Array

#: Axes of the world: east, north, up (REP-103) or north, east, down; those of the body go with
#: them: forward, left, up or forward, right, down.
CONVENTIONS = ('enu', 'ned')
#: Its own inverse.
_ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FLU_FROM_FRD = np.diag([1.0, -1.0, -1.0])
#: The sine of a pitch beyond which roll and yaw are about one axis.
_LOCKED = 1.0 - 1e-12


class Mounting(NamedTuple):
    """How a sensor is turned against its body.

    Parameters
    ----------
    rotation
        Roll, pitch and yaw of the sensor in the axes of the body, in rad, as in a transform from
        the frame of the body to that of the sensor.
    convention
        One of `CONVENTIONS`.
    frame
        The frame of its messages; '' for that of the first.
    placed
        Whether its place or its rotation is given.
    """

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    convention: str = 'enu'
    frame: str = ''
    placed: bool = False

    @property
    def turned(self) -> bool:
        """Whether its axes are others than those of the body and the world."""
        return any(self.rotation) or self.convention != 'enu'

    @property
    def body_from_sensor(self) -> Array:
        """The rotation (3, 3) of vectors from the axes of the sensor to those of the body."""
        R = rotation_matrix(*self.rotation)
        return np.asarray(R @ _FLU_FROM_FRD if self.convention == 'ned' else R)

    @property
    def world_from_reported(self) -> Array:
        """The rotation (3, 3) of places from the axes of the messages to east, north, up."""
        return _ENU_FROM_NED if self.convention == 'ned' else np.eye(3)


#: As the body, unless its messages say otherwise.
STRAIGHT = Mounting()


def mounting(
    rotation: Sequence[float], convention: str, frame: str, translation: Sequence[float]
) -> Mounting:
    """Return the mounting by the options of a sensor.

    Raises
    ------
    ValueError
        If one is wrong; the message names it.
    """
    if len(rotation) != 3 or not np.isfinite(rotation).all():
        got = ', '.join(f'{angle:g}' for angle in rotation)
        raise ValueError(f'mount.rotation: expected roll, pitch and yaw in rad, got ({got})')
    if convention not in CONVENTIONS:
        raise ValueError(f"convention: expected {' or '.join(CONVENTIONS)}, got '{convention}'")
    if frame.startswith('/'):
        raise ValueError(f"frame: expected a name without a leading slash, got '{frame}'")
    roll, pitch, yaw = map(float, rotation)
    placed = any(rotation) or any(translation)
    return Mounting((roll, pitch, yaw), convention, frame, placed)


def rotation_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation (3, 3) about the fixed axes x, y, z, in this order (REP-103)."""
    cr, sr, cp, sp, cy, sy = cos(roll), sin(roll), cos(pitch), sin(pitch), cos(yaw), sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Return the angles of a rotation (3, 3) about the fixed axes x, y, z.

    At a pitch of 90 degrees, where roll and yaw are about one axis, roll is zero.
    """
    (r11, r12, _), (r21, r22, _), (r31, r32, r33) = R.tolist()
    if abs(r31) >= _LOCKED:
        return 0.0, copysign(pi / 2.0, -r31), atan2(-r12, r22)
    pitch = asin(-r31) if abs(r31) < 0.5 else atan2(-r31, hypot(r32, r33))
    return atan2(r32, r33), pitch, atan2(r21, r11)


def quaternion_matrix(x: float, y: float, z: float, w: float) -> Array:
    """Return the rotation (3, 3) of a quaternion of any length; NaN for one of zero.

    J. Diebel, Representing Attitude (2006), section 6.4.
    """
    norm = x * x + y * y + z * z + w * w
    if not norm > 0.0:
        return np.full((3, 3), np.nan)
    s = 2.0 / norm
    return np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    )
