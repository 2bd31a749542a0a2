# SPDX-License-Identifier: Apache-2.0
"""Reads and writes vectors in serialised messages in place.

The conversion between Python objects and bytes takes most of the time that a small message costs
a Python node, and nearly all of it is avoidable: see `layout`, and docs/explanation/messages.md.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

from kalman_ros.core import Array

from .layout import Layout, Sample, learn
from .messages import decode, stamp_of
from .padding import without_padding
from .signal_codec import SignalCodec
from .signal_codecs import Codec
from .turned_codec import TurnedCodec

#: Layouts cached per topic: publishers may differ in theirs.
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


class WireReader:
    """Decodes the serialised messages of a signal like `SignalCodec`, but faster.

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
        self._layouts: list[Layout] = []

    def __call__(self, data: bytes) -> Sample:
        """Return the sample in a message.

        Raises
        ------
        UndecodableError
            If the bytes are not those of such a message.
        LookupError, ValueError
            If an array of the message is too short, too long, or lacks a name.
        """
        sample = self._read(data)
        if self._turn is None:
            return sample
        time, values, covariance = sample
        return Sample(time, *self._turn(values, covariance))

    def _read(self, data: bytes) -> Sample:
        for layout in self._layouts:
            if layout.fits(data):
                return layout.read(data)
        codec = self._codec
        message = decode(data, self.message_type)
        values, covariance = codec.decode(message), codec.decode_covariance(message)
        sample = Sample(stamp_of(message), values, covariance)
        if self._may_learn and isinstance(codec, SignalCodec):
            learnt = learn(codec, message, data)
            self._may_learn = learnt is not None
            if learnt is not None:
                self._layouts = [learnt, *self._layouts[: _MOST_LAYOUTS - 1]]
        return sample


class WireWriter:
    """Encodes the vectors of a signal like `SignalCodec`, but faster.

    Fields that cannot be learnt (not float64, or angles as quaternions) are always encoded as a
    message object. Publish the result at once: the object is reused.
    """

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self.message_type = codec.message_type
        layout = _written_layout(codec)
        self._layout = layout if _learns else None

    def __call__(self, time: int, values: Array, covariance: Array | None = None) -> Any:
        """Return the message, as bytes or as an object, stamped ``time`` in nanoseconds."""
        if self._layout is None:
            return self._codec.encode(time, values, covariance)
        return self._layout.write(Sample(time, values, covariance))


def _written_layout(codec: Codec) -> Layout | None:
    """Return the layout of messages of ``codec``; None if they cannot be written by position."""
    n = codec.size
    message = codec.encode(0, np.zeros(n), np.zeros((n, n)))
    if not isinstance(codec, SignalCodec):
        return None
    data = without_padding(bytes(serialize_message(message)), message)
    layout = learn(codec, decode(data, codec.message_type), data)
    return layout if codec.carries_covariance or not codec.has_covariance else None
