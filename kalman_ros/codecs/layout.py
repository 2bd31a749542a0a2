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

from .messages import STAMP, STAMP_START
from .padding import without_padding
from .paths import Way
from .signal_codec import SignalCodec

#: Bits of the first mark; marks are unlikely numbers, which count up from here.
_FIRST_MARK = 0x7E57C0DE00000000
#: Plain CDR aligns a float64 to 8 bytes, counted from after the four leading bytes.
BASE, SIZE = 4, 8

#: Positions of numbers, in steps of 8 bytes from `BASE`.
Places = npt.NDArray[np.intp]


class Sample(NamedTuple):
    """A stamp in nanoseconds or None, a vector (n,), and its covariance (n, n) or None."""

    time: Optional[int]
    values: Array
    covariance: Optional[Array]


class Layout(NamedTuple):
    """Positions of the numbers in a message, in steps of 8 bytes from the start of its fields.

    Parameters
    ----------
    data
        Example of such a message.
    fixed
        Parts that are equal in every message of this layout.
    values
        Position of each coordinate (n,).
    covariance
        Elements of the covariance (n, n) in a message, and the position of each; or None.
    stamped
        Whether the message begins with a header.
    declaring, declared
        Covariances that may declare a field as absent, and the positions of their first elements.
    """

    data: bytes
    fixed: list[slice]
    values: Places
    covariance: Optional[tuple[Any, Places]]
    stamped: bool
    declaring: list[Way]
    declared: Places


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
    if len(marked) < len(data) or marked[:BASE] != data[:BASE]:  # e.g. another byte order
        return None
    try:
        # padding has what was in memory, also half of an earlier mark
        marked = without_padding(marked, message)
        used = without_padding(b'\xff' * len(data), message)
    except NotImplementedError:
        return None
    positions = _marks_in(marked, count)
    if positions is None:
        return None
    values, covariance = codec.decode(message), codec.decode_covariance(message)
    elements: Any = ...
    if covariance is not None:
        # between two blocks of a covariance there are zeros that the message does not contain
        nonzero = covariance != 0.0
        elements = ... if nonzero.all() else nonzero
        covariance = covariance[elements]
    marks = values if covariance is None else np.append(values, covariance)
    if not (_numbers_of(marks) < count).all():  # a value computed from a field is not a mark
        return None
    places = None if covariance is None else (elements, positions[_numbers_of(covariance)])
    declared = positions[_numbers_of(np.array(codec.declarations(message)))]
    fixed = _fixed_runs(data, marked, used, positions, stamped)
    where = positions[_numbers_of(values)]
    return Layout(data, fixed, where, places, stamped, codec.declaring, declared)


def _numbers_of(marks: Array) -> npt.NDArray[np.uint64]:
    """Return the indices of these marks in message order; the last one bounds them."""
    bits: npt.NDArray[np.uint64] = np.ascontiguousarray(marks).view(np.uint64)
    return np.asarray(bits - np.uint64(_FIRST_MARK))


def _marks_in(marked: bytes, count: int) -> Places | None:
    """Return the position of each of ``count`` marks; None unless each occurs exactly once."""
    cells = np.frombuffer(marked, '<u8', max(len(marked) - BASE, 0) // SIZE, BASE)
    numbers = cells - np.uint64(_FIRST_MARK)
    places = np.flatnonzero(numbers < count)
    positions = np.full(count, -1, np.intp)
    positions[numbers[places]] = places
    return positions if len(places) == count and (positions >= 0).all() else None


def _fixed_runs(
    data: bytes, marked: bytes, used: bytes, positions: Places, stamped: bool
) -> list[slice]:
    """Return the slices in which bytes must be equal: all except numbers, stamp and padding.

    ``marked`` equals ``data`` except for its numbers. Padding, which is zero in ``used``, may
    have any value: the publisher's earlier memory.
    """
    fixed = np.frombuffer(data, np.uint8) == np.frombuffer(marked, np.uint8)
    fixed &= np.frombuffer(used, np.uint8) != 0
    for byte in range(SIZE):
        fixed[BASE + SIZE * positions + byte] = False
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
