# SPDX-License-Identifier: Apache-2.0
"""Inputs in messages."""

from __future__ import annotations

from typing import Any

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Signal
from kalman_ros.scenario.input_place import at_centre


class InputDecoder:
    """Decoder of an input, which is moved from its place to the centre of the body."""

    def __init__(self, signal: Signal) -> None:
        self._read, self._moved = WireReader(codec_of(signal)), at_centre(signal)
        self.message_type: Any = self._read.message_type

    def __call__(self, data: bytes) -> Sample:
        """Return the input in a message.

        Raises
        ------
        UndecodableError, LookupError, ValueError
            If the bytes are not those of such a message, or the input is not in it.
        """
        sample = self._read(data)
        if self._moved is None:
            return sample
        return sample._replace(values=self._moved(sample.time, sample.values))
