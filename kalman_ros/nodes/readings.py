# SPDX-License-Identifier: Apache-2.0
"""From a sensor's message to a reading with the covariance that is to be used for it."""

from __future__ import annotations

from typing import Any, Optional

import numpy as np

from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.core import Array, Signal
from kalman_ros.simulation.scenario import SensorSource

#: The values (k,), and their covariance (k, k) unless it is the configured one.
Reading = tuple[Array, Optional[Array]]


class ReadingDecoder:
    """Decodes the messages of one sensor."""

    def __init__(self, signal: Signal) -> None:
        self._codec = SignalCodec(signal)
        self.message_type = self._codec.message_type

    def __call__(self, message: Any, source: SensorSource) -> Reading:
        """Return the reading; a message that cannot be read gives one of no values."""
        try:
            y = self._codec.decode(message)
            if source.covariance_from == 'configuration':
                return y, None
            R = self._codec.decode_covariance(message)
        except (LookupError, ValueError):
            return np.empty(0), None
        own = source.sensor.covariance
        if R is None or (source.covariance_from == 'larger' and np.trace(R) <= np.trace(own)):
            return y, None
        return y, R
