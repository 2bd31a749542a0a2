# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages, in addition to those of the other sets."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..messages import Body, Form, joint, vectors
from ..second.messages import FORMS as OTHERS


def _place_and_yaw(stamp: int, y: Sequence[float]) -> bytes:
    """Return a pose in the plane; the fourth number is the variance of the place, in m^2.

    The variance of the yaw is a hundredth of it, in rad^2.
    """
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = y[3]
    covariance[35] = 0.01 * y[3]
    turned = 0, 0, math.sin(0.5 * y[2]), math.cos(0.5 * y[2])
    return Body().header(stamp, 'map').put('d', y[0], y[1], 0, *turned, *covariance).done()


def _legs(stamp: int, y: Sequence[float]) -> bytes:
    """Return velocities forward, left and about the vertical, without a covariance."""
    body = Body().header(stamp, 'odom').text('base_link')
    body.put('d', 0, 0, 0, 0, 0, 0, 1, *[0] * 36)
    return body.put('d', y[0], y[1], 0, 0, 0, y[2], *[0] * 36).done()


def _battery(stamp: int, y: Sequence[float]) -> bytes:
    """Return the state of a battery of which only the voltage is known."""
    body = Body().header(stamp, 'base_link').put('f', y[0], *[math.nan] * 6)
    return body.put('B', 2, 1, 3, 1).put('I', 0, 0).text('').text('').done()


_JOINT = 'sensor_msgs/msg/JointState'
_TWIST = 'geometry_msgs/msg/TwistStamped'
_WRENCH = 'geometry_msgs/msg/WrenchStamped'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'place_and_yaw': ('geometry_msgs/msg/PoseWithCovarianceStamped', _place_and_yaw),
    'legs': ('nav_msgs/msg/Odometry', _legs),
    'battery': ('sensor_msgs/msg/BatteryState', _battery),
    'field': ('sensor_msgs/msg/MagneticField', vectors('base_link', 12, 0, 1, 2)),
    'velocity': (_TWIST, vectors('base_link', 6, 0, 1, 2)),
    'walk': (_TWIST, vectors('base_link', 6, 0, 1, 5)),
    'push_and_turn': (_WRENCH, vectors('base_link', 6, 0, 5)),
    'thrusters': (_WRENCH, vectors('base_link', 6, 0, 2, 5)),
    'pan_and_tilt': (_WRENCH, vectors('base_link', 6, 5, 4)),
    'wheel': (_JOINT, joint('wheel', 1)),
    'steering': (_JOINT, joint('steering', 0)),
    'pan': (_JOINT, joint('pan', 0)),
    'tilt': (_JOINT, joint('tilt', 0)),
    'cart': (_JOINT, joint('cart', 0)),
    'pole': (_JOINT, joint('pole', 0)),
}
