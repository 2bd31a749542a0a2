# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: with covariances, and with other fields than the first set."""

from __future__ import annotations

from collections.abc import Sequence

from ..messages import DATUM, Body, Form, fix_body, joint, vectors
from ..messages import FORMS as OTHERS


def _altitude(stamp: int, y: Sequence[float]) -> bytes:
    """Return a fix at the datum whose altitude is the reading."""
    body = Body().header(stamp, 'base_link').put('b', 0).put('H', 1)
    return body.put('d', *DATUM, y[0], *[0] * 9).put('B', 0).done()


def _fix_with_covariance(stamp: int, y: Sequence[float]) -> bytes:
    """Return a fix by metres east and north, with the variance of both as a third number."""
    return fix_body(stamp, y, (y[2], 0, 0, 0, y[2], 0, 0, 0, 4.0 * y[2]), 2)


def _pose_with_covariance(stamp: int, y: Sequence[float]) -> bytes:
    """Return a place in the map, with the variance of both coordinates as a third number."""
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = y[2]
    body = Body().header(stamp, 'map').put('d', y[0], y[1], 0, 0, 0, 0, 1)
    return body.put('d', *covariance).done()


def _imu_with_covariance(stamp: int, y: Sequence[float]) -> bytes:
    """Return angular rates and accelerations, with the variances of both as numbers 7 and 8."""
    turn, push = ([v, 0, 0, 0, v, 0, 0, 0, v] for v in y[6:8])
    body = Body().header(stamp, 'base_link').put('d', 0, 0, 0, 1, -1, *[0] * 8)
    return body.put('d', *y[:3], *turn, *y[3:6], *push).done()


_POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
_JOINT = 'sensor_msgs/msg/JointState'
_WRENCH = 'geometry_msgs/msg/WrenchStamped'
#: The type and the bytes of each form, those of the first set included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'altitude': ('sensor_msgs/msg/NavSatFix', _altitude),
    'fix_with_covariance': ('sensor_msgs/msg/NavSatFix', _fix_with_covariance),
    'pose_with_covariance': (_POSE, _pose_with_covariance),
    'imu_with_covariance': ('sensor_msgs/msg/Imu', _imu_with_covariance),
    'triple': ('geometry_msgs/msg/PointStamped', vectors('map', 3, 0, 1, 2)),
    'climb': ('geometry_msgs/msg/TwistStamped', vectors('base_link', 6, 2)),
    'force': (_WRENCH, vectors('base_link', 6, 0)),
    'spin': (_WRENCH, vectors('base_link', 6, 5)),
    'trolley': (_JOINT, joint('trolley', 0)),
    'left': (_JOINT, joint('left', 1)),
    'right': (_JOINT, joint('right', 1)),
    'axle': (_JOINT, joint('axle', 1)),
    'drive_torque': (_JOINT, joint('shaft', 2)),
}
