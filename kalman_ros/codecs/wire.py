# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of vectors in serialised messages, in place.

The conversion between Python objects and bytes takes most of the time that a small message costs
a Python node, and nearly all of it is avoidable: see `layout`, and docs/explanation/messages.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from rclpy.serialization import serialize_message

from kalman_ros.core import Array

from .covariances import ABSENT, refuse_absent
from .layout import BASE, SIZE, Layout, Places, Sample, learn
from .messages import (
    STAMP,
    STAMP_START,
    UndecodableError,
    decode,
    leading_stamp,
    split,
    stamp_of,
    stamps_of,
)
from .padding import without_padding
from .signal_codec import SignalCodec
from .signal_codecs import Codec
from .turned_codec import TurnedCodec

#: Type of the numbers in a message: to find it by its name takes as long as to read them.
_FLOAT64 = np.dtype('<f8')
#: Number of layouts cached per topic, since publishers may differ in theirs.
_MOST_LAYOUTS = 4

_learns = True


def learn_layouts(*, on: bool) -> None:
    """Enable or disable layouts in the readers and writers that this process builds later.

    Both ways give the same numbers; without layouts each message goes through Python
    objects, which takes longer. It is one switch for the process: readers and writers are built
    in a dozen places that know no option of a node, and each node has a process to itself. Where
    several nodes share one, the last that is configured decides.
    """
    global _learns
    _learns = on


class _CachedCovariance:
    """The covariance in messages of one layout, which hardly changes between messages.

    Parameters
    ----------
    elements, places
        Elements of the covariance, and the position of each in a message.
    n
        Number of its rows.
    """

    def __init__(self, elements: Any, places: Places, n: int) -> None:
        self._elements, self.places, self._shape = elements, places, (n, n)
        start, end = (int(places.min()), int(places.max()) + 1) if places.size else (0, 0)
        self._run = slice(BASE + SIZE * start, BASE + SIZE * end)
        self._bytes = b''
        self._last: Array = np.zeros(self._shape)

    def __call__(self, data: bytes, numbers: Array) -> Array:
        """Return the covariance (n, n), read-only: the array of the last message, if the same."""
        content = data[self._run]
        if content != self._bytes:
            self._bytes, self._last = content, self.matrix(numbers)
        return self._last

    def matrix(self, numbers: Array) -> Array:
        """Return the covariance (n, n) among the numbers of a message, read-only."""
        matrix = np.zeros(self._shape)
        matrix[self._elements] = numbers[self.places]
        matrix.flags.writeable = False
        return matrix


class Samples(NamedTuple):
    """Many messages: stamps (N,) in nanoseconds or None, and vectors (N, n).

    Parameters
    ----------
    covariances, which
        Covariances (n, n) that follow each other, none if the messages have none, and the index
        of that of each message.
    """

    time: Any
    values: Array
    covariances: Sequence[Array]
    which: Any


class _Template:
    """A message from which others differ in the stamp and the numbers only."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._length = len(layout.data)
        self._count = (self._length - BASE) // SIZE
        self._fixed = [(run, layout.data[run]) for run in layout.fixed]
        self._buffer = bytearray(layout.data)
        self._numbers = self._numbers_of(self._buffer)
        self._covariance = (
            _CachedCovariance(*layout.covariance, len(layout.values))
            if layout.covariance
            else None
        )

    def _numbers_of(self, data: bytes | bytearray) -> Array:
        return np.frombuffer(data, _FLOAT64, self._count, BASE)

    def fits(self, data: bytes) -> bool:
        """Return whether another message has its numbers at the same positions."""
        if len(data) != self._length:
            return False
        for run, same in self._fixed:  # noqa: SIM110  a generator takes twice as long
            if data[run] != same:
                return False
        return True

    def read(self, data: bytes) -> Sample:
        """Return the contents of a message that `fits`; AbsentError if it declares absence."""
        _, _, values, _, stamped, declaring, declared = self._layout
        numbers = self._numbers_of(data)
        if declaring:
            refuse_absent(declaring, numbers[declared].tolist())
        time = leading_stamp(data) if stamped else None
        cached = self._covariance
        return Sample(time, numbers[values], None if cached is None else cached(data, numbers))

    def read_all(self, messages: Sequence[bytes]) -> Samples | None:
        """Return the contents of many messages; None if one does not fit or declares absence."""
        length, layout = self._length, self._layout
        if {*map(len, messages)} != {length}:
            return None
        table = np.frombuffer(b''.join(messages), np.uint8).reshape(len(messages), length)
        for run, same in self._fixed:
            if (table[:, run] != np.frombuffer(same, np.uint8)).any():
                return None
        numbers: Array = table[:, BASE : BASE + SIZE * self._count].copy().view('<f8')
        if (numbers[:, layout.declared] == ABSENT).any():
            return None
        time = stamps_of(table) if layout.stamped else None
        if self._covariance is None:
            return Samples(time, numbers[:, layout.values], (), np.zeros(len(table), dtype=int))
        given = numbers[:, self._covariance.places.ravel()].view(np.int64)
        differs = np.concatenate(([True], (given[1:] != given[:-1]).any(axis=1)))
        matrices = [self._covariance.matrix(numbers[at]) for at in np.flatnonzero(differs)]
        return Samples(time, numbers[:, layout.values], matrices, np.cumsum(differs) - 1)

    def write(self, sample: Sample) -> bytes:
        """Return the message with another stamp and other numbers.

        Without a covariance, the one of the last message is kept.
        """
        time, values, covariance = sample
        layout, numbers = self._layout, self._numbers
        numbers[layout.values] = values
        if covariance is not None and layout.covariance is not None:
            elements, places = layout.covariance
            numbers[places] = covariance[elements]
        if layout.stamped and time is not None:
            STAMP.pack_into(self._buffer, STAMP_START, *split(time))
        return bytes(self._buffer)


class WireReader:
    """Decoder of the serialised messages of a signal: like `SignalCodec`, but faster.

    Fields that are not float64, and angles of quaternions, are always decoded through Python
    objects.
    """

    def __init__(self, codec: Codec) -> None:
        self._turn = None
        if isinstance(codec, TurnedCodec) and codec.linear:
            self._turn, codec = codec.turn, codec.inner
        self._codec = codec
        self.message_type = codec.message_type
        self._may_learn = _learns
        self._templates: list[_Template] = []

    def __call__(self, data: bytes) -> Sample:
        """Return the sample in a message.

        Raises
        ------
        UndecodableError
            If the bytes are not those of such a message.
        LookupError, ValueError
            If an array of the message is too short, too long, or lacks a name.
        """
        for template in self._templates:
            if template.fits(data):
                sample = template.read(data)
                break
        else:
            sample = self._learnt(data)
        if self._turn is None:
            return sample
        time, values, covariance = sample
        return Sample(time, *self._turn(values, covariance))

    def read_all(self, messages: Sequence[bytes]) -> Samples | None:
        """Return the samples in many messages of one layout, at once; None if that is not so.

        They are those of calls for each.
        """
        if not self._templates and self._may_learn:
            with suppress(UndecodableError, LookupError, ValueError):
                self._learnt(messages[0])
        for template in self._templates:
            samples = template.read_all(messages)
            if samples is None or self._turn is None:
                if samples is not None:
                    return samples
                continue
            turned = [self._turn(values, None)[0] for values in samples.values]
            matrices: Any = [self._turn(samples.values[0], C)[1] for C in samples.covariances]
            return samples._replace(values=np.array(turned), covariances=matrices)
        return None

    def _learnt(self, data: bytes) -> Sample:
        """Return the sample in a message through an object, and learn its layout."""
        codec = self._codec
        message = decode(data, self.message_type)
        values, covariance = codec.decode(message), codec.decode_covariance(message)
        sample = Sample(stamp_of(message), values, covariance)
        if self._may_learn and isinstance(codec, SignalCodec):
            learnt = learn(codec, message, data)
            self._may_learn = learnt is not None
            if learnt is not None:
                self._templates = [_Template(learnt), *self._templates[: _MOST_LAYOUTS - 1]]
        return sample


class WireWriter:
    """Encoder of the vectors of a signal: like `SignalCodec`, but faster.

    Fields that cannot be learnt (not float64, or angles as quaternions) are always encoded as a
    message object. Publish the result at once: the object is reused.
    """

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self.message_type = codec.message_type
        layout = _written_layout(codec)
        self._template = _Template(layout) if _learns and layout is not None else None

    def __call__(self, time: int, values: Array, covariance: Array | None = None) -> Any:
        """Return the message, as bytes or as an object, stamped ``time`` in nanoseconds."""
        if self._template is None:
            return self._codec.encode(time, values, covariance)
        return self._template.write(Sample(time, values, covariance))


def _written_layout(codec: Codec) -> Layout | None:
    """Return the layout of messages of ``codec``; None if they cannot be written by position."""
    n = codec.size
    message = codec.encode(0, np.zeros(n), np.zeros((n, n)))
    if not isinstance(codec, SignalCodec):
        return None
    data = without_padding(bytes(serialize_message(message)), message)
    layout = learn(codec, decode(data, codec.message_type), data)
    return layout if codec.carries_covariance or not codec.has_covariance else None
