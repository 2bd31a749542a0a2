# SPDX-License-Identifier: Apache-2.0
"""Ticks of lockstep on the wire: a stamp, and on which topics readings come at that step.

A topic alone means a reading that is stamped as the tick; a late one is named with its own stamp
in nanoseconds, ``position@1050000000``. A topic that is named twice has two readings.

Which topics there are mostly repeats from step to step, so only the stamp of the tick is written
and read again.
"""

from __future__ import annotations

from functools import lru_cache

from rclpy.serialization import serialize_message
from sensor_msgs.msg import TimeReference

from .messages import (
    STAMP,
    STAMP_START,
    UndecodableError,
    decode,
    leading_stamp,
    split,
)

#: A stamp in nanoseconds has fewer.
_DIGITS = 20
#: The longest tick, in bytes, whose topics are kept.
_KEPT = 4096
#: No plant publishes more readings at one step, nor names them by more bytes.
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
        If it is none, or no plant's: one that is longer, or names more readings.
    """
    if len(data) > _LONGEST:
        raise UndecodableError(f'no tick is as long as {len(data)} bytes')
    time, end = leading_stamp(data), STAMP_START + STAMP.size
    unstamped = data[:STAMP_START] + bytes(STAMP.size) + data[end:]
    # what is kept takes memory, and a sender may make up any number of long ones
    topics = _topics if len(data) <= _KEPT else _topics.__wrapped__
    found = topics(unstamped)
    if len(found) > _MOST_READINGS:
        raise UndecodableError(f'no tick names as many readings as {len(found)}')
    return time, found


def mention(topic: str, stamp: int, time: int) -> str:
    """Return how the tick at ``time`` names a reading; both are in nanoseconds."""
    return topic if stamp == time else f'{topic}@{stamp}'


def mentioned(text: str, time: int) -> tuple[str, int]:
    """Return the topic and the stamp of a reading that the tick at ``time`` names.

    What is behind the sign and no stamp belongs to the name, which is then that of no topic.
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
