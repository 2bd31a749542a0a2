# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: a pose in space, several ranges, and commands of attitude."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..fourth.messages import FORMS as OTHERS
from ..fourth.messages import joints
from ..messages import Body, Form, vectors
from .rotations import Quaternion, exponential, product


def _pose(stamp: int, y: Sequence[float]) -> bytes:
    """Return a pose by its position, its rotation vector, and an error about the map's axes."""
    q: Quaternion = product(exponential(y[6:9]), exponential(y[3:6]))
    return Body().header(stamp, 'map').put('d', *y[:3], *q[1:], q[0]).done()


def _course(stamp: int, y: Sequence[float]) -> bytes:
    """Return a velocity in the map by speed and course."""
    east, north = y[0] * math.cos(y[1]), y[0] * math.sin(y[1])
    return Body().header(stamp, 'map').put('d', east, north, *[0] * 4).done()


_JOINT = 'sensor_msgs/msg/JointState'
_TWIST = 'geometry_msgs/msg/TwistStamped'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'pose': ('geometry_msgs/msg/PoseStamped', _pose),
    'ranges': (_JOINT, joints(0, 'a', 'b', 'c', 'd')),
    'two_wheels': (_JOINT, joints(1, 'left', 'right')),
    'plate': (_JOINT, joints(0, 'alpha', 'beta')),
    'flow': (_TWIST, vectors('base_link', 6, 3, 4)),
    'roll_pitch_climb': (_TWIST, vectors('base_link', 6, 3, 4, 2)),
}
