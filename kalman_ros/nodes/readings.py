# SPDX-License-Identifier: Apache-2.0
"""From a sensor's message to a reading with the covariance that is to be used for it."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Signal
from kalman_ros.simulation.scenario import SensorSource


class ReadingReader:
    """Decodes the messages of one sensor."""

    def __init__(self, signal: Signal) -> None:
        self._read = WireReader(SignalCodec(signal))
        self.message_type = self._read.message_type

    def __call__(self, data: bytes, source: SensorSource) -> Sample:
        """Return the reading; its covariance is None if the configured one is to be used.

        A message that cannot be read gives a reading of no values, which no filter takes.
        """
        try:
            sample = self._read(data)
        except (LookupError, ValueError):
            return Sample(None, np.empty(0), None)
        return sample._replace(covariance=source.used(sample.covariance))
