# SPDX-License-Identifier: Apache-2.0
"""Reads vectors straight out of serialised messages.

Most of what a small message costs a Python node is its conversion to Python objects. Nearly all
of that is avoidable: from one message of a publisher to the next only the stamp and the numbers
change, so where each number stands needs to be learnt only once. Whatever else differs from the
message that was learnt from (a name, a length, the byte order) leads to learning anew.
"""

from __future__ import annotations

import struct
from itertools import count
from typing import Any, NamedTuple, Optional

import numpy as np
import numpy.typing as npt
from rclpy.serialization import deserialize_message, serialize_message

from kalman_ros.core import Array

from .messages import stamp_of
from .signal_codec import SignalCodec

#: The stamp of a leading header, behind the four bytes that begin every message.
_STAMP = struct.Struct('<4xiI')
_HEADLESS_END, _STAMP_END = 4, 12
#: Marks are numbers that no message has by chance: these bits, and a counter.
_FIRST_MARK = 0x7E57C0DE00000000


class Sample(NamedTuple):
    """A stamp in nanoseconds or None, a vector (n,), and its covariance (n, n) or None."""

    time: Optional[int]
    values: Array
    covariance: Optional[Array]


def leading_stamp(data: bytes) -> int:
    """Return the stamp of a serialised message whose type begins with a header, in ns."""
    seconds, rest = _STAMP.unpack_from(data)
    return int(seconds) * 1_000_000_000 + int(rest)


class WireReader:
    """Decodes the serialised messages of a signal: what `SignalCodec` does, sooner.

    Fields that are not float64 numbers, and angles of quaternions, are decoded by way of Python
    objects every time.
    """

    def __init__(self, codec: SignalCodec) -> None:
        self._codec = codec
        self.message_type = codec.message_type
        self._may_learn = True
        self._layout: _Layout | None = None

    def __call__(self, data: bytes) -> Sample:
        """Return what a message says.

        Raises
        ------
        LookupError, ValueError
            If an array of the message is too short, too long, or lacks a name.
        """
        layout = self._layout
        if layout is not None and layout.fits(data):
            return layout.read(data)
        codec = self._codec
        message = deserialize_message(data, self.message_type)
        values, covariance = codec.decode(message), codec.decode_covariance(message)
        sample = Sample(stamp_of(message), values, covariance)
        if self._may_learn:
            self._layout = _learn(codec, message, data)
            self._may_learn = self._layout is not None
        return sample


class _Layout:
    """Where the numbers of a message stand, in steps of 8 bytes from ``_base`` on."""

    def __init__(
        self,
        data: bytes,
        marked: bytes,
        offsets: dict[float, int],
        values: Array,
        covariance: Array | None,
        stamped: bool,
    ) -> None:
        self._stamped = stamped
        self._base = min(offsets.values()) % 8
        self._count = (len(data) - self._base) // 8
        self._length = len(data)
        self._values = self._places(offsets, values)
        self._covariance = None
        if covariance is not None:
            # what stands between two blocks of a covariance is zero and not in the message
            there = np.flatnonzero(covariance)
            self._covariance = (there, self._places(offsets, covariance.ravel()[there]))
        self._fixed = [(run, data[run]) for run in _fixed_runs(data, marked, offsets, stamped)]

    def _places(self, offsets: dict[float, int], marks: Array) -> npt.NDArray[np.intp]:
        return np.array([(offsets[mark] - self._base) // 8 for mark in marks.tolist()], np.intp)

    def read(self, data: bytes) -> Sample:
        """Return what a message says that `fits`."""
        numbers = np.frombuffer(data, dtype='<f8', count=self._count, offset=self._base)
        time = leading_stamp(data) if self._stamped else None
        if self._covariance is None:
            return Sample(time, numbers[self._values], None)
        own, places = self._covariance
        n = len(self._values)
        flat = np.zeros(n * n)
        flat[own] = numbers[places]
        return Sample(time, numbers[self._values], flat.reshape(n, n))

    def fits(self, data: bytes) -> bool:
        """Tell whether another message has its numbers in the same places."""
        return len(data) == self._length and all(data[gap] == same for gap, same in self._fixed)


def _fixed_runs(
    data: bytes, marked: bytes, offsets: dict[float, int], stamped: bool
) -> list[slice]:
    """Return where bytes must stay the same: all but numbers, the stamp, and padding.

    ``marked`` says the same as ``data`` but for its numbers; what differs besides is padding,
    which may be anything.
    """
    fixed = np.frombuffer(data, np.uint8) == np.frombuffer(marked, np.uint8)
    for offset in offsets.values():
        fixed[offset : offset + 8] = False
    if stamped:
        fixed[_HEADLESS_END:_STAMP_END] = False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], fixed, [False]))))
    return [slice(start, end) for start, end in zip(edges[::2].tolist(), edges[1::2].tolist())]


def _learn(codec: SignalCodec, message: Any, data: bytes) -> _Layout | None:
    """Return the layout of messages like this one; None if its fields cannot be read so.

    Every float64 of the message is replaced by a mark of its own; where the marks are found
    in the serialised bytes, and which of them the codec picks, is all that there is to know.
    """
    marks: list[float] = []
    _mark(message, marks, count(_FIRST_MARK))
    # a serialised message may be longer than what goes over the wire, by zeros
    marked = bytes(serialize_message(message))[: len(data)]
    offsets = {mark: marked.find(struct.pack('<d', mark)) for mark in marks}
    values, covariance = codec.decode(message), codec.decode_covariance(message)
    wanted = values if covariance is None else np.append(values, covariance[covariance != 0.0])
    if any(offsets.get(mark, -1) < 0 for mark in wanted.tolist()) or len(marked) < len(data):
        return None
    kinds = message.get_fields_and_field_types()
    stamped = next(iter(kinds.values())) == 'std_msgs/Header'
    if hasattr(message, 'header') and not stamped:
        return None
    offsets = {mark: offset for mark, offset in offsets.items() if offset >= 0}
    return _Layout(data, marked, offsets, values, covariance, stamped)


def _mark(message: Any, marks: list[float], bits: Any) -> None:
    """Replace every float64 number below ``message`` by a mark, and list the marks."""

    def mark() -> float:
        number: float = struct.unpack('<d', struct.pack('<Q', next(bits)))[0]
        marks.append(number)
        return number

    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if kind == 'double':
            setattr(message, name, mark())
        elif kind.startswith(('double[', 'sequence<double')):
            for index in range(len(value)):
                value[index] = mark()
        elif hasattr(value, 'get_fields_and_field_types'):
            _mark(value, marks, bits)
