# SPDX-License-Identifier: Apache-2.0
"""Reads vectors from serialised messages in place, and writes them in place.

Most of what a small message costs a Python node is its conversion between Python objects and
bytes, and nearly all of that is avoidable: see `layout`, and docs/explanation/messages.md.
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

#: Layouts kept for each topic: publishers may differ in theirs.
_MOST_LAYOUTS = 4

_learns = True


def learn_layouts(*, on: bool) -> None:
    """Have the readers and writers that this process builds from now on learn layouts, or not.

    Both ways give the same numbers; without layouts each message goes through Python
    objects, which takes longer.
    """
    global _learns
    _learns = on


class WireReader:
    """Decodes the serialised messages of a signal: what `SignalCodec` does, sooner.

    Fields that are not float64 numbers, and angles of quaternions, are decoded by way of Python
    objects every time.
    """

    def __init__(self, codec: SignalCodec) -> None:
        self._codec = codec
        self.message_type = codec.message_type
        self._may_learn = _learns
        self._layouts: list[Layout] = []

    def __call__(self, data: bytes) -> Sample:
        """Return what a message says.

        Raises
        ------
        UndecodableError
            If the bytes are not those of such a message.
        LookupError, ValueError
            If an array of the message is too short, too long, or lacks a name.
        """
        for layout in self._layouts:
            if layout.fits(data):
                return layout.read(data)
        codec = self._codec
        message = decode(data, self.message_type)
        values, covariance = codec.decode(message), codec.decode_covariance(message)
        sample = Sample(stamp_of(message), values, covariance)
        if self._may_learn:
            learnt = learn(codec, message, data)
            self._may_learn = learnt is not None
            if learnt is not None:
                self._layouts = [learnt, *self._layouts[: _MOST_LAYOUTS - 1]]
        return sample


class WireWriter:
    """Encodes the vectors of a signal as serialised messages: what `SignalCodec` does, sooner.

    What the wire cannot be learnt of (fields that are not float64, angles as quaternions) is
    encoded as a message object every time. Publish what comes at once: an object is reused.
    """

    def __init__(self, codec: SignalCodec) -> None:
        self._codec = codec
        self.message_type = codec.message_type
        self._layout = _written_layout(codec) if _learns else None

    def __call__(self, time: int, values: Array, covariance: Array | None = None) -> Any:
        """Return the message, as bytes or as an object, stamped ``time`` in nanoseconds."""
        if self._layout is None:
            return self._codec.encode(time, values, covariance)
        return self._layout.write(Sample(time, values, covariance))


def _written_layout(codec: SignalCodec) -> Layout | None:
    """Return the layout of what ``codec`` encodes; None if it cannot be written so."""
    n = codec.size
    message = codec.encode(0, np.zeros(n), np.zeros((n, n)))
    data = without_padding(bytes(serialize_message(message)), message)
    layout = learn(codec, decode(data, codec.message_type), data)
    return layout if codec.carries_covariance or not codec.has_covariance else None
