# SPDX-License-Identifier: Apache-2.0
"""Message types by name, and the stamps in message headers."""

from __future__ import annotations

import importlib
import os
import struct
from contextlib import nullcontext
from time import monotonic
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from rosidl_generator_py.import_type_support_impl import UnsupportedTypeSupport

_NANOSECONDS = 1_000_000_000
#: The seconds of a stamp are a signed 32-bit number.
_FIRST, _LAST = -(2**31) * _NANOSECONDS, 2**31 * _NANOSECONDS - 1
#: The stamp of a leading header in a serialised message.
STAMP = struct.Struct('<iI')
_BIG_ENDIAN_STAMP = struct.Struct('>iI')
#: Position of the stamp, after the four leading bytes of every message.
STAMP_START = 4
#: Length of the frame after it, whose last byte is zero.
_LENGTH = struct.Struct('<I')
_BIG_ENDIAN_LENGTH = struct.Struct('>I')
#: Position of the frame of a leading header.
FRAME_START = STAMP_START + STAMP.size


def has_header(type: str) -> bool:
    """Return whether messages of a type, ``package/Name``, have a header with a stamp."""
    return 'header' in message_type(type).get_fields_and_field_types()


def message_type(name: str) -> Any:
    """Return the class of ``package/Name`` (``package/msg/Name`` is the same).

    Raises
    ------
    ValueError
        If the package is not installed, cannot be loaded, or has no such message.
    """
    package, _, kind = name.replace('/msg/', '/').partition('/')
    if not package.isidentifier() or not kind.isidentifier():
        raise ValueError(f"type: expected 'package/Name', got '{name}'")
    try:
        message_class = getattr(importlib.import_module(f'{package}.msg'), kind, None)
    except ImportError:
        raise ValueError(f"type: the message package '{package}' is not installed") from None
    if message_class is None:
        raise ValueError(f"type: the package '{package}' has no message '{kind}'")
    try:
        # as rclpy does at the first use, where it would end in a traceback
        if getattr(type(message_class), '_TYPE_SUPPORT', '') is None:
            type(message_class).__import_type_support__()
    except UnsupportedTypeSupport:
        where = 'is their folder in LD_LIBRARY_PATH?'
        raise ValueError(f"type: cannot load the libraries of '{package}': {where}") from None
    return message_class


def full_type(name: str) -> str:
    """Return the type ``package/Name`` as ``package/msg/Name``, as in the graph and in bags."""
    return name.replace('/msg/', '/').replace('/', '/msg/')


class UndecodableError(Exception):
    """Error of bytes that do not match the type of their message.

    It is no ValueError: readers handle invalid contents of a decoded message in many ways; here
    only the size is known.
    """


def decode(data: bytes, kind: Any) -> Any:
    """Return the message of type ``kind`` that was serialised as ``data``.

    Raises
    ------
    UndecodableError
        If the bytes do not match: truncated, or of another type.
    """
    global _failed
    try:
        with _Silence() if monotonic() - _failed < _PAUSE else nullcontext():
            return deserialize_message(data, kind)
    except Exception as error:  # rclpy's exception is not public
        if monotonic() - _failed >= _PAUSE:
            _failed = monotonic()
        raise UndecodableError(f'{len(data)} bytes are no {kind.__name__}') from error


#: Seconds after a failure in which no other failure is logged.
_PAUSE = 1.0
_failed = -_PAUSE


class _Silence:
    """Suppression of the middleware's output for each message that it cannot read.

    A sender could fill a disk with these lines; they have neither level nor logger.
    """

    def __enter__(self) -> None:
        self._errors = os.dup(2)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        os.close(nowhere)

    def __exit__(self, *_: object) -> None:
        os.dup2(self._errors, 2)
        os.close(self._errors)


def stamp_of(message: Any) -> int | None:
    """Return the stamp of a message's header in nanoseconds; None if it has no header."""
    header = getattr(message, 'header', None)
    return None if header is None else nanoseconds(header.stamp)


def nanoseconds(stamp: Any) -> int:
    """Return a ``builtin_interfaces/Time`` as whole nanoseconds."""
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


def write_stamp(stamp: Any, time: int) -> None:
    """Write ``time`` in nanoseconds into a ``builtin_interfaces/Time``, in place."""
    stamp.sec, stamp.nanosec = split(time)


def split(time: int) -> tuple[int, int]:
    """Return ``time`` in nanoseconds as whole seconds and remaining nanoseconds.

    Times outside the range of stamps are clipped to it.
    """
    return divmod(min(max(time, _FIRST), _LAST), _NANOSECONDS)


def stamps_of(messages: Any) -> Any:
    """Return the stamps (N,) in ns of little-endian messages, the bytes of which are rows."""
    first = messages[:, STAMP_START : STAMP_START + STAMP.size].copy()
    seconds, rest = first[:, :4].copy().view('<i4')[:, 0], first[:, 4:].copy().view('<u4')[:, 0]
    return seconds.astype(np.int64) * _NANOSECONDS + rest


def leading_stamp(data: bytes) -> int:
    """Return the stamp of a serialised message whose type begins with a header, in ns.

    Raises
    ------
    UndecodableError
        If the message is too short for a stamp.
    """
    if len(data) < STAMP_START + STAMP.size:
        raise UndecodableError(f'{len(data)} bytes have no room for a stamp')
    stamp = STAMP if data[1] & 1 else _BIG_ENDIAN_STAMP
    seconds, rest = stamp.unpack_from(data, STAMP_START)
    return int(seconds) * _NANOSECONDS + int(rest)


def leading_frame(data: bytes) -> str:
    """Return the frame of a serialised message whose type begins with a header, '' if unset."""
    return frame_and_end(data)[0]


def frame_and_end(data: bytes, *, of_child: bool = False) -> tuple[str, int]:
    """Return the frame in a leading header, or the ``child_frame_id`` after it, and its end.

    A leading slash is omitted.
    """
    length = _LENGTH if data[1] & 1 else _BIG_ENDIAN_LENGTH
    start, end = FRAME_START, FRAME_START
    for _ in range(2 if of_child else 1):
        start = end + -end % length.size + length.size
        end = start + length.unpack_from(data, start - length.size)[0]
    return data[start:end].rstrip(b'\0').decode(errors='replace').lstrip('/'), end
