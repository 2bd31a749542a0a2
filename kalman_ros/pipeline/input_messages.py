# SPDX-License-Identifier: Apache-2.0
"""Inputs in messages: as read and written at their place, and as used at the centre of a body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import Samples, WireReader, WireWriter
from kalman_ros.core import Array, Signal
from kalman_ros.scenario.input_place import at_centre


class InputDecoder:
    """Decoder of an input, which is moved from its place to the centre of the body."""

    def __init__(self, signal: Signal) -> None:
        #: Reads an input at its place.
        self.read, self._place = WireReader(codec_of(signal)), at_centre(signal)
        self.message_type: Any = self.read.message_type

    def __call__(self, data: bytes) -> Sample:
        """Return the input in a message.

        Raises
        ------
        UndecodableError, LookupError, ValueError
            If the bytes are not those of such a message, or the input is not in it.
        """
        return self.moved(self.read(data))

    def read_all(self, messages: Sequence[bytes]) -> Samples | None:
        """Return the inputs in many messages at once, as calls; None if that is not possible."""
        return self.read.read_all(messages) if self._place is None else None

    def moved(self, sample: Sample) -> Sample:
        """Return what was read at its place, at the centre."""
        if self._place is None:
            return sample
        return sample._replace(values=self._place(sample.time, sample.values))


class InputEncoder:
    """Encoder of an input at the centre of the body, as it is at its place."""

    def __init__(self, signal: Signal, frame: str) -> None:
        self._write, self._place = WireWriter(codec_of(signal, frame)), at_centre(signal)
        self.message_type: Any = self._write.message_type

    def __call__(self, time: int, values: Array) -> Any:
        """Return the message, as bytes or as an object, stamped ``time`` in nanoseconds."""
        if self._place is not None:
            values = self._place.away(time, values)
        return self._write(time, values)
