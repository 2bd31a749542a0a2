# SPDX-License-Identifier: Apache-2.0
"""The positions of numbers among the serialised bytes of a message.

The messages of a publisher differ only in the stamp and the numbers, so the position of each
number is learnt once. Learning takes time and memory in proportion to the length of the message.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Optional

import numpy as np
import numpy.typing as npt
from rclpy.serialization import serialize_message

from kalman_ros.core import Array

from .covariances import refuse_absent
from .messages import STAMP, STAMP_START, leading_stamp, split
from .padding import without_padding
from .paths import Way
from .signal_codec import SignalCodec

#: Marks are unlikely numbers: these bits, and a counter.
_FIRST_MARK = 0x7E57C0DE00000000
#: Plain CDR aligns a float64 to 8 bytes, counted from after the four leading bytes.
_BASE, _SIZE = 4, 8

#: Positions of numbers, in steps of 8 bytes from `_BASE`.
_Places = npt.NDArray[np.intp]


class Sample(NamedTuple):
    """A stamp in nanoseconds or None, a vector (n,), and its covariance (n, n) or None."""

    time: Optional[int]
    values: Array
    covariance: Optional[Array]


class Layout:
    """The positions of a message's numbers, in steps of 8 bytes from the start of its fields.

    Parameters
    ----------
    data
        A message.
    fixed
        The parts that are equal in every message of this layout.
    values
        The position of each coordinate (n,).
    covariance
        The elements of the covariance (n, n) in a message, and the position of each; or None.
    stamped
        Whether the message begins with a header.
    declaring, declared
        The covariances that may say that a field is absent, and the position of each one's first
        element.
    """

    def __init__(
        self,
        data: bytes,
        fixed: list[slice],
        values: _Places,
        covariance: tuple[Any, _Places] | None,
        stamped: bool,
        declaring: list[Way],
        declared: _Places,
    ) -> None:
        self._stamped = stamped
        self._length = len(data)
        self._count = (len(data) - _BASE) // _SIZE
        self._values, self._covariance = values, covariance
        self._declaring, self._declared = declaring, declared
        self._fixed = [(run, data[run]) for run in fixed]
        self._buffer = bytearray(data)
        self._numbers = self._numbers_of(self._buffer)

    def _numbers_of(self, data: bytes | bytearray) -> Array:
        return np.frombuffer(data, '<f8', self._count, _BASE)

    def read(self, data: bytes) -> Sample:
        """Return the contents of a message that `fits`; AbsentError if it says there are none."""
        numbers = self._numbers_of(data)
        if self._declaring:
            refuse_absent(self._declaring, numbers[self._declared].tolist())
        time = leading_stamp(data) if self._stamped else None
        if self._covariance is None:
            return Sample(time, numbers[self._values], None)
        own, places = self._covariance
        n = len(self._values)
        covariance = np.zeros((n, n))
        covariance[own] = numbers[places]
        return Sample(time, numbers[self._values], covariance)

    def write(self, sample: Sample) -> bytes:
        """Return the learnt message with another stamp and other numbers.

        Without a covariance, that of the last message is kept.
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
        """Return whether another message has its numbers at the same positions."""
        if len(data) != self._length:
            return False
        for run, same in self._fixed:  # noqa: SIM110  a generator takes twice as long
            if data[run] != same:
                return False
        return True


def learn(codec: SignalCodec, message: Any, data: bytes) -> Layout | None:
    """Return the layout of messages like this one; None if they cannot be read by position.

    Every float64 of the message is replaced by a unique mark; their positions in the
    serialised bytes, and those that the codec reads, define the layout.
    """
    kinds = message.get_fields_and_field_types()
    stamped = next(iter(kinds.values())) == 'std_msgs/Header'
    if hasattr(message, 'header') and not stamped:
        return None
    count = _mark(message, 0)
    # a serialised message may be longer than its wire form, by zeros
    marked = bytes(serialize_message(message))[: len(data)]
    if len(marked) < len(data) or marked[:_BASE] != data[:_BASE]:  # e.g. another byte order
        return None
    there = _marks_in(marked, count)
    if there is None:
        return None
    values, covariance = codec.decode(message), codec.decode_covariance(message)
    own: Any = ...
    if covariance is not None:
        # between two blocks of a covariance there are zeros that the message does not contain
        carried = covariance != 0.0
        own = ... if carried.all() else carried
        covariance = covariance[own]
    wanted = values if covariance is None else np.append(values, covariance)
    if not (_numbers_of(wanted) < count).all():  # a value computed from a field is not a mark
        return None
    places = None if covariance is None else (own, there[_numbers_of(covariance)])
    declared = there[_numbers_of(np.array(codec.declarations(message)))]
    try:
        used = without_padding(b'\xff' * len(data), message)
    except NotImplementedError:
        return None
    fixed = _fixed_runs(data, marked, used, there, stamped)
    where = there[_numbers_of(values)]
    return Layout(data, fixed, where, places, stamped, codec.declaring, declared)


def _numbers_of(marks: Array) -> npt.NDArray[np.uint64]:
    """Return the indices of these marks in message order; the last one bounds them."""
    bits: npt.NDArray[np.uint64] = np.ascontiguousarray(marks).view(np.uint64)
    return np.asarray(bits - np.uint64(_FIRST_MARK))


def _marks_in(marked: bytes, count: int) -> _Places | None:
    """Return the position of each of ``count`` marks; None unless each occurs exactly once."""
    cells = np.frombuffer(marked, '<u8', max(len(marked) - _BASE, 0) // _SIZE, _BASE)
    numbers = cells - np.uint64(_FIRST_MARK)
    places = np.flatnonzero(numbers < count)
    there = np.full(count, -1, np.intp)
    there[numbers[places]] = places
    return there if len(places) == count and (there >= 0).all() else None


def _fixed_runs(
    data: bytes, marked: bytes, used: bytes, there: _Places, stamped: bool
) -> list[slice]:
    """Return the positions where bytes must be equal: all but numbers, stamp and padding.

    ``marked`` equals ``data`` except for its numbers. Padding, which is zero in ``used``, may
    have any value: the publisher's earlier memory.
    """
    fixed = np.frombuffer(data, np.uint8) == np.frombuffer(marked, np.uint8)
    fixed &= np.frombuffer(used, np.uint8) != 0
    for byte in range(_SIZE):
        fixed[_BASE + _SIZE * there + byte] = False
    if stamped:
        fixed[STAMP_START : STAMP_START + STAMP.size] = False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], fixed, [False]))))
    return [slice(start, end) for start, end in zip(edges[::2].tolist(), edges[1::2].tolist())]


def _mark(message: Any, first: int) -> int:
    """Replace every float64 within ``message`` by a mark, from number ``first`` on.

    Return the number of the next mark.
    """
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if kind == 'double':
            setattr(message, name, float(_marks(first, 1)[0]))
            first += 1
        elif kind.startswith(('double[', 'sequence<double')):
            if len(value):
                np.frombuffer(value)[:] = _marks(first, len(value))
            first += len(value)
        elif hasattr(value, 'get_fields_and_field_types'):
            first = _mark(value, first)
    return first


def _marks(first: int, count: int) -> Array:
    start = _FIRST_MARK + first
    return np.arange(start, start + count, dtype=np.uint64).view(np.float64)
