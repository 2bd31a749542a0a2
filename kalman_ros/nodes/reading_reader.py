# SPDX-License-Identifier: Apache-2.0
"""From a sensor's message to a reading with the covariance that is to be used for it."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Signal
from kalman_ros.scenario import SensorSource


class ReadingReader:
    """Decodes the messages of one sensor."""

    def __init__(self, signal: Signal) -> None:
        self._read = WireReader(SignalCodec(signal))
        self.message_type = self._read.message_type
        #: Why the last message that could not be read could not; '' before the first.
        self.trouble = ''

    def __call__(self, data: bytes, source: SensorSource) -> Sample:
        """Return the reading; its covariance is None if the configured one is to be used.

        A message without the fields that it should have gives a reading of no values, which no
        filter takes.

        Raises
        ------
        UndecodableError
            If the bytes are not those of such a message.
        """
        try:
            sample = self._read(data)
        except (LookupError, ValueError) as error:
            self.trouble = str(error)
            return Sample(None, np.empty(0), None)
        time, values, covariance = sample
        return Sample(time, values, source.used(covariance))
