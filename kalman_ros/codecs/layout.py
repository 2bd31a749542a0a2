# SPDX-License-Identifier: Apache-2.0
"""Where the numbers of a message stand among its serialised bytes.

From one message of a publisher to the next only the stamp and the numbers change, so where each
number stands needs to be learnt only once.
"""

from __future__ import annotations

import struct
from itertools import count
from typing import Any, NamedTuple, Optional

import numpy as np
import numpy.typing as npt
from rclpy.serialization import serialize_message

from kalman_ros.core import Array

from .messages import STAMP, STAMP_START, leading_stamp, split
from .signal_codec import SignalCodec

#: Marks are numbers that no message has by chance: these bits, and a counter.
_FIRST_MARK = 0x7E57C0DE00000000


class Sample(NamedTuple):
    """A stamp in nanoseconds or None, a vector (n,), and its covariance (n, n) or None."""

    time: Optional[int]
    values: Array
    covariance: Optional[Array]


class Layout:
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
            there = covariance != 0.0
            whole = ... if there.all() else there
            self._covariance = (whole, self._places(offsets, covariance[whole]))
        self._fixed = [(run, data[run]) for run in _fixed_runs(data, marked, offsets, stamped)]
        self._buffer = bytearray(data)
        self._numbers = self._numbers_of(self._buffer)

    def _places(self, offsets: dict[float, int], marks: Array) -> npt.NDArray[np.intp]:
        found = [(offsets[mark] - self._base) // 8 for mark in marks.ravel().tolist()]
        return np.array(found, np.intp).reshape(marks.shape)

    def _numbers_of(self, data: bytes | bytearray) -> Array:
        return np.frombuffer(data, '<f8', self._count, self._base)

    def read(self, data: bytes) -> Sample:
        """Return what a message says that `fits`."""
        numbers = self._numbers_of(data)
        time = leading_stamp(data) if self._stamped else None
        if self._covariance is None:
            return Sample(time, numbers[self._values], None)
        own, places = self._covariance
        n = len(self._values)
        covariance = np.zeros((n, n))
        covariance[own] = numbers[places]
        return Sample(time, numbers[self._values], covariance)

    def write(self, sample: Sample) -> bytes:
        """Return the message that was learnt from, with another stamp and other numbers.

        Without a covariance, that of the last message stays.
        """
        time, values, covariance = sample
        numbers = self._numbers
        numbers[self._values] = values
        if covariance is not None and self._covariance is not None:
            own, places = self._covariance
            numbers[places] = covariance[own]
        if self._stamped and time is not None:
            STAMP.pack_into(self._buffer, STAMP_START, *split(time))
        return bytes(self._buffer)

    def fits(self, data: bytes) -> bool:
        """Tell whether another message has its numbers in the same places."""
        if len(data) != self._length:
            return False
        for run, same in self._fixed:  # noqa: SIM110  a generator takes twice as long
            if data[run] != same:
                return False
        return True


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
        fixed[STAMP_START : STAMP_START + STAMP.size] = False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], fixed, [False]))))
    return [slice(start, end) for start, end in zip(edges[::2].tolist(), edges[1::2].tolist())]


def learn(codec: SignalCodec, message: Any, data: bytes) -> Layout | None:
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
    return Layout(data, marked, offsets, values, covariance, stamped)


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
