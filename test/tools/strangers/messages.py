# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 2 as bytes (CDR, little-endian), and readings as a recording."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from kalman_ros.bags.definitions import definition
from kalman_ros.bags.mcap_writer import McapWriter

from .simulation import Readings

#: When all recordings begin, in s since 1970.
EPOCH = 1_700_000_000
#: Latitude and longitude, in degrees, of the origin of all maps; its height is 0.
DATUM = 47.5, 9.7
#: WGS-84: the equatorial radius in m, and the square of the eccentricity.
_RADIUS, _SQUARE = 6378137.0, 6.69437999014e-3
#: Returns the bytes of a message, by its stamp in nanoseconds and its numbers.
Form = Callable[[int, Sequence[float]], bytes]
_DEFAULT_QUALITY = {'offered_qos_profiles': '[]', 'topic_type_hash': ''}


class Body:
    """The body of a message, whose numbers are aligned to their size."""

    def __init__(self) -> None:
        self._body = bytearray()

    def put(self, code: str, *numbers: float) -> Body:
        """Append numbers of one type, by its code in ``struct``."""
        for number in numbers:
            self._body += bytes(-len(self._body) % struct.calcsize(f'<{code}'))
            self._body += struct.pack(f'<{code}', number)
        return self

    def text(self, text: str) -> Body:
        """Append a string."""
        self.put('I', len(text) + 1)
        self._body += text.encode() + b'\0'
        return self

    def header(self, stamp: int, frame: str) -> Body:
        """Append a header with a stamp in nanoseconds."""
        return self.put('i', stamp // 10**9).put('I', stamp % 10**9).text(frame)

    def done(self) -> bytes:
        """Return the message."""
        return b'\0\1\0\0' + bytes(self._body)


def _imu(stamp: int, y: Sequence[float]) -> bytes:
    """Return angular rates and accelerations, without an orientation."""
    body = Body().header(stamp, 'base_link').put('d', 0, 0, 0, 1, -1, *[0] * 8)
    return body.put('d', *y[:3], *[0] * 9, *y[3:], *[0] * 9).done()


def _compass(stamp: int, y: Sequence[float]) -> bytes:
    """Return an orientation that is a heading."""
    body = Body().header(stamp, 'base_link')
    body.put('d', 0, 0, math.sin(0.5 * y[0]), math.cos(0.5 * y[0]), *[0] * 9)
    return body.put('d', *[0] * 3, -1, *[0] * 8, *[0] * 3, -1, *[0] * 8).done()


def fix_body(stamp: int, y: Sequence[float], covariance: Sequence[float], known: int) -> bytes:
    """Return a place by its metres east and north of the datum, with a covariance of some type."""
    latitude = math.radians(DATUM[0])
    share = 1.0 - _SQUARE * math.sin(latitude) ** 2
    along = _RADIUS * (1.0 - _SQUARE) / share**1.5
    # the second order of the plane that touches: meridians converge
    north = y[1] - 0.5 * y[0] ** 2 * math.tan(latitude) / (_RADIUS / math.sqrt(share))
    here = latitude + north / along
    across = _RADIUS / math.sqrt(share) * math.cos(here)
    place = math.degrees(here), DATUM[1] + math.degrees(y[0] / across)
    body = Body().header(stamp, 'base_link').put('b', 0).put('H', 1)
    return body.put('d', *place, 0.0, *covariance).put('B', known).done()


def _fix(stamp: int, y: Sequence[float]) -> bytes:
    """Return a place by its metres east and north of the datum, without a covariance."""
    return fix_body(stamp, y, [0] * 9, 0)


def _odometry(stamp: int, y: Sequence[float]) -> bytes:
    """Return the forward speed and the turn rate of wheels."""
    body = Body().header(stamp, 'odom').text('base_link')
    body.put('d', 0, 0, 0, 0, 0, 0, 1, *[0] * 36)
    return body.put('d', y[0], 0, 0, 0, 0, y[1], *[0] * 36).done()


def vectors(frame: str, size: int, *places: int) -> Form:
    """Return the form of a header and vectors of ``size`` numbers, given at these places."""

    def form(stamp: int, y: Sequence[float]) -> bytes:
        numbers = [0.0] * size
        for place, number in zip(places, y):
            numbers[place] = number
        return Body().header(stamp, frame).put('d', *numbers).done()

    return form


def joint(name: str, field: int) -> Form:
    """Return the form of one joint's position (0), velocity (1) or effort (2)."""

    def form(stamp: int, y: Sequence[float]) -> bytes:
        body = Body().header(stamp, '').put('I', 1).text(name)
        for k in range(3):
            body.put('I', int(k == field))
            if k == field:
                body.put('d', y[0])
        return body.done()

    return form


def _range(stamp: int, y: Sequence[float]) -> bytes:
    """Return a distance, without a variance or limits, since some are of either sign."""
    return Body().header(stamp, 'base_link').put('B', 0).put('f', 0.1, 0, 0, y[0], 0).done()


def _scalar(stamp: int, y: Sequence[float]) -> bytes:
    """Return a number with a variance of 0, an unknown one."""
    return Body().header(stamp, 'base_link').put('d', y[0], 0).done()


def _bare(stamp: int, y: Sequence[float]) -> bytes:
    """Return a number without a stamp."""
    return Body().put('d', y[0]).done()


def _list(stamp: int, y: Sequence[float]) -> bytes:
    """Return numbers without a stamp."""
    return Body().put('I', 0, 0, len(y)).put('d', *y).done()


#: The type and the bytes of each form.
FORMS: dict[str, tuple[str, Form]] = {
    'imu': ('sensor_msgs/msg/Imu', _imu),
    'compass': ('sensor_msgs/msg/Imu', _compass),
    'fix': ('sensor_msgs/msg/NavSatFix', _fix),
    'odometry': ('nav_msgs/msg/Odometry', _odometry),
    'point': ('geometry_msgs/msg/PointStamped', vectors('map', 3, 0, 1)),
    'speed': ('geometry_msgs/msg/TwistStamped', vectors('base_link', 6, 0)),
    'drive': ('geometry_msgs/msg/TwistStamped', vectors('base_link', 6, 0, 5)),
    'lift': ('geometry_msgs/msg/AccelStamped', vectors('base_link', 6, 2)),
    'torque': ('geometry_msgs/msg/WrenchStamped', vectors('base_link', 6, 4)),
    'thrust': ('geometry_msgs/msg/WrenchStamped', vectors('base_link', 6, 2, 4)),
    'angle': ('sensor_msgs/msg/JointState', joint('shaft', 0)),
    'turning': ('sensor_msgs/msg/JointState', joint('shaft', 1)),
    'heater': ('sensor_msgs/msg/JointState', joint('heater', 2)),
    'range': ('sensor_msgs/msg/Range', _range),
    'pressure': ('sensor_msgs/msg/FluidPressure', _scalar),
    'temperature': ('sensor_msgs/msg/Temperature', _scalar),
    'number': ('std_msgs/msg/Float64', _bare),
    'numbers': ('std_msgs/msg/Float64MultiArray', _list),
}


def write_recording(
    path: Path, readings: Readings, forms: Mapping[str, tuple[str, Form]] = FORMS
) -> None:
    """Write all messages into a new MCAP file, in the order in which they were received."""
    file = McapWriter(path, 'strangers')
    messages = []
    for name in sorted(readings):
        channel = readings[name]
        kind, form = forms[channel.form]
        number = file.add(f'/{channel.topic}', kind, definition(kind), _DEFAULT_QUALITY)
        rows = (channel.value + channel.noise).tolist()
        for stamp, received, row in zip(channel.stamp, channel.received, rows):
            stamped, arrived = (EPOCH * 10**9 + round(t * 1e9) for t in (stamp, received))
            messages.append((arrived, number, form(stamped, row)))
    for arrived, number, data in sorted(messages, key=lambda message: message[:2]):
        file.write(number, arrived, data, arrived)
    file.close()
