# SPDX-License-Identifier: Apache-2.0
"""Rates and latencies that nodes measure for their diagnostics."""

from __future__ import annotations

from collections import deque
from math import inf
from time import monotonic

import numpy as np

#: The number of recent events.
_LENGTH = 500
#: Without an event for N seconds, or three usual intervals, the rate is zero.
_SILENCE = 2.0


class Rate:
    """The recent rate of an event."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=_LENGTH)

    def count(self) -> float:
        """Record an event; return the time, in seconds of a steady clock."""
        now = monotonic()
        self._times.append(now)
        return now

    @property
    def silence(self) -> float:
        """Seconds since the last event; infinite before the first."""
        return monotonic() - self._times[-1] if self._times else inf

    @property
    def value(self) -> float:
        """Events per second; zero before the second event and after a silence."""
        if len(self._times) < 2:
            return 0.0
        interval = (self._times[-1] - self._times[0]) / (len(self._times) - 1)
        if self.silence > max(_SILENCE, 3.0 * interval):
            return 0.0
        return 1.0 / interval if interval > 0.0 else 0.0


class Latency:
    """Percentiles of recent durations."""

    def __init__(self) -> None:
        self._seconds: deque[float] = deque(maxlen=_LENGTH)

    def add(self, seconds: float) -> None:
        """Add one duration."""
        self._seconds.append(seconds)

    def __str__(self) -> str:
        """Return the 50th, 90th and 99th percentile in ms; '' before the first."""
        if not self._seconds:
            return ''
        percentiles = 1e3 * np.percentile(self._seconds, (50, 90, 99))
        return ' / '.join(f'{value:.3g}' for value in percentiles)
