# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: those of the real recordings."""

from __future__ import annotations

from collections.abc import Sequence

from ..messages import Body, Form, vectors
from ..second import messages


def _place(stamp: int, y: Sequence[float]) -> bytes:
    """Return a fix by latitude and longitude in degrees and height, without a covariance."""
    body = Body().header(stamp, 'base_link').put('b', 0).put('H', 1)
    return body.put('d', *y, *[0] * 9).put('B', 0).done()


def _attitude(stamp: int, y: Sequence[float]) -> bytes:
    """Return an orientation by its quaternion, without rates and accelerations."""
    body = Body().header(stamp, 'base_link').put('d', *y, *[0] * 9)
    return body.put('d', *[0] * 3, -1, *[0] * 8, *[0] * 3, -1, *[0] * 8).done()


def _echo(stamp: int, y: Sequence[float]) -> bytes:
    """Return range, bearing and range rate as positions of joints of these names."""
    body = Body().header(stamp, 'base_link').put('I', 3)
    for name in ('range', 'bearing', 'range_rate'):
        body.text(name)
    return body.put('I', 3).put('d', *y).put('I', 0, 0).done()


#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **messages.FORMS,
    'place': ('sensor_msgs/msg/NavSatFix', _place),
    'attitude': ('sensor_msgs/msg/Imu', _attitude),
    'echo': ('sensor_msgs/msg/JointState', _echo),
    'field': ('sensor_msgs/msg/MagneticField', vectors('base_link', 12, 0, 1, 2)),
}
