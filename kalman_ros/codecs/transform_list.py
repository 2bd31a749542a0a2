# SPDX-License-Identifier: Apache-2.0
"""The transforms in a serialised ``tf2_msgs/TFMessage``, read without that package."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from .messages import UndecodableError

#: Largest number of transforms of a message that are read.
_MOST = 10_000
#: Messages begin with four bytes, after which positions are counted.
_START = 4


class StampedTransform(NamedTuple):
    """The place of a frame in its parent: translation in m, and a quaternion x, y, z, w.

    The time is in nanoseconds.
    """

    time: int
    parent: str
    child: str
    translation: tuple[float, ...]
    quaternion: tuple[float, ...]

    @property
    def is_rigid(self) -> bool:
        """Whether it is a place and a rotation: all numbers finite, the quaternion not zero."""
        numbers = (*self.translation, *self.quaternion)
        return all(map(math.isfinite, numbers)) and any(self.quaternion)


def transforms_in(data: bytes) -> list[StampedTransform]:
    """Return the transforms in the bytes of a ``tf2_msgs/TFMessage`` (OMG CDR, version 1).

    Raises
    ------
    UndecodableError
        If the bytes are not those of such a message.
    """
    try:
        order = '<' if data[1] & 1 else '>'
        (count,) = struct.unpack_from(f'{order}I', data, _START)
        if count > _MOST:
            raise UndecodableError(f'{count} transforms')
        transforms, place = [], _START + 4
        for _ in range(count):
            place = _aligned(place, 4)
            seconds, nanoseconds = struct.unpack_from(f'{order}iI', data, place)
            parent, place = _text(data, place + 8, order)
            child, place = _text(data, place, order)
            place = _aligned(place, 8)
            numbers = struct.unpack_from(f'{order}7d', data, place)
            place += 56
            time = seconds * 1_000_000_000 + nanoseconds
            transforms.append(StampedTransform(time, parent, child, numbers[:3], numbers[3:]))
    except (struct.error, IndexError) as error:
        raise UndecodableError(f'{len(data)} bytes are no TFMessage') from error
    return transforms


def _aligned(place: int, size: int) -> int:
    return place + -(place - _START) % size


def _text(data: bytes, place: int, order: str) -> tuple[str, int]:
    """Return a string and its end; a leading slash is omitted."""
    start = _aligned(place, 4) + 4
    end = start + struct.unpack_from(f'{order}I', data, start - 4)[0]
    if end > len(data):
        raise UndecodableError(f'{len(data)} bytes are no TFMessage')
    return data[start:end].rstrip(b'\0').decode(errors='replace').lstrip('/'), end
