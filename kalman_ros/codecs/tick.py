# SPDX-License-Identifier: Apache-2.0
"""Ticks of lockstep on the wire: a stamp, and the topics with readings at that step.

A topic alone means a reading with the stamp of the tick; a late one is named with its stamp in
nanoseconds, ``position@1050000000``. A topic named twice has two readings.

The topics mostly repeat from step to step, so only the stamp of the tick is written and read
again.
"""

from __future__ import annotations

from functools import lru_cache

from rclpy.serialization import serialize_message
from sensor_msgs.msg import TimeReference

from .messages import STAMP, STAMP_START, UndecodableError, decode, leading_stamp, split

#: Number of digits that no stamp in nanoseconds has.
_DIGITS = 20
#: Longest tick, in bytes, whose topics are cached.
_KEPT = 4096
#: Largest number of readings that a plant publishes at one step, and of bytes that name them.
_MOST_READINGS, _LONGEST = 1000, 65536


def write_tick(time: int, topics: tuple[str, ...]) -> bytes:
    """Return the tick of the step at ``time``, in nanoseconds, with readings on ``topics``."""
    data = bytearray(_unstamped(topics))
    STAMP.pack_into(data, STAMP_START, *split(time))
    return bytes(data)


def read_tick(data: bytes) -> tuple[int, tuple[str, ...]]:
    """Return the time and the topics of a tick.

    Raises
    ------
    UndecodableError
        If it is not a valid tick, is too long, or has too many readings.
    """
    if len(data) > _LONGEST:
        raise UndecodableError(f'no tick is as long as {len(data)} bytes')
    time, end = leading_stamp(data), STAMP_START + STAMP.size
    unstamped = data[:STAMP_START] + bytes(STAMP.size) + data[end:]
    # cached entries use memory, and a sender may create any number of long ones
    parse = _topics if len(data) <= _KEPT else _topics.__wrapped__
    topics = parse(unstamped)
    if len(topics) > _MOST_READINGS:
        raise UndecodableError(f'no tick names as many readings as {len(topics)}')
    return time, topics


def mention(topic: str, stamp: int, time: int) -> str:
    """Return the name of a reading in the tick at ``time``; both are in nanoseconds."""
    return topic if stamp == time else f'{topic}@{stamp}'


def mentioned(text: str, time: int) -> tuple[str, int]:
    """Return the topic and the stamp of a reading named in the tick at ``time``.

    If the text after the sign is not a stamp, it belongs to the name, which then matches no topic.
    """
    if '@' not in text:
        return text, time
    topic, _, stamp = text.partition('@')
    is_stamp = stamp.isdecimal() and len(stamp) < _DIGITS
    return (topic, int(stamp)) if is_stamp else (text, time)


@lru_cache(maxsize=256)
def _unstamped(topics: tuple[str, ...]) -> bytes:
    return bytes(serialize_message(TimeReference(source=','.join(topics))))


@lru_cache(maxsize=256)
def _topics(unstamped: bytes) -> tuple[str, ...]:
    source = decode(unstamped, TimeReference).source
    return tuple(topic for topic in source.split(',') if topic)
