# SPDX-License-Identifier: Apache-2.0
"""How often and how late: what nodes measure of themselves for their diagnostics."""

from __future__ import annotations

from collections import deque
from math import inf
from time import monotonic

import numpy as np

#: So many events are looked back on.
_LENGTH = 500
#: Without an event for N seconds, or three usual intervals, the rate is zero.
_SILENCE = 2.0


class Rate:
    """How often something happens a second, lately."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=_LENGTH)

    def count(self) -> float:
        """Take note that it happens now; return the time, in seconds of a steady clock."""
        now = monotonic()
        self._times.append(now)
        return now

    @property
    def silence(self) -> float:
        """Seconds since the last event; infinite before the first."""
        return monotonic() - self._times[-1] if self._times else inf

    @property
    def value(self) -> float:
        """Events a second; zero before the second event and after a silence."""
        if len(self._times) < 2:
            return 0.0
        interval = (self._times[-1] - self._times[0]) / (len(self._times) - 1)
        if self.silence > max(_SILENCE, 3.0 * interval):
            return 0.0
        return 1.0 / interval if interval > 0.0 else 0.0


class Latency:
    """Percentiles of how long something takes, lately."""

    def __init__(self) -> None:
        self._seconds: deque[float] = deque(maxlen=_LENGTH)

    def add(self, seconds: float) -> None:
        """Take one duration in."""
        self._seconds.append(seconds)

    def __str__(self) -> str:
        """Return the 50th, 90th and 99th percentile in ms; nothing before the first."""
        if not self._seconds:
            return ''
        found = 1e3 * np.percentile(self._seconds, (50, 90, 99))
        return ' / '.join(f'{value:.3g}' for value in found)
