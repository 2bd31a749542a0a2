# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: several joints in one message, and an attitude."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..messages import Body, Form, vectors
from ..third.messages import FORMS as OTHERS


def joints(field: int, *names: str) -> Form:
    """Return the form of the positions (0), velocities (1) or efforts (2) of several joints."""

    def form(stamp: int, y: Sequence[float]) -> bytes:
        body = Body().header(stamp, '').put('I', len(names))
        for name in names:
            body.text(name)
        for k in range(3):
            numbers = [*y] if k == field else []
            body.put('I', len(numbers)).put('d', *numbers)
        return body.done()

    return form


def _attitude(stamp: int, y: Sequence[float]) -> bytes:
    """Return an orientation by roll, pitch and yaw, without rates and accelerations."""
    (a, b, c), (p, q, r) = ([f(0.5 * angle) for angle in y] for f in (math.cos, math.sin))
    turned = p * b * c - a * q * r, a * q * c + p * b * r, a * b * r - p * q * c
    body = Body().header(stamp, 'base_link').put('d', *turned, a * b * c + p * q * r, *[0] * 9)
    return body.put('d', *[0] * 3, -1, *[0] * 8, *[0] * 3, -1, *[0] * 8).done()


_JOINT = 'sensor_msgs/msg/JointState'
_TWIST = 'geometry_msgs/msg/TwistStamped'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'attitude': ('sensor_msgs/msg/Imu', _attitude),
    'hitch': (_JOINT, joints(0, 'hitch')),
    'arm': (_JOINT, joints(0, 'shoulder', 'elbow')),
    'arm_torques': (_JOINT, joints(2, 'shoulder', 'elbow')),
    'mecanum': (_JOINT, joints(1, 'fl', 'fr', 'rl', 'rr')),
    'auv_thrusters': (_JOINT, joints(2, 'surge', 'fore', 'aft')),
    'speed_and_bank': (_TWIST, vectors('base_link', 6, 0, 3)),
    'surge_and_heave': (_TWIST, vectors('base_link', 6, 0, 2)),
}
