# SPDX-License-Identifier: Apache-2.0
"""Warnings at a limited rate, each message separately."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

#: The most different messages remembered; a hostile sender could create any number.
_MOST = 20


class Throttle:
    """Logs each message at most once within N seconds.

    The throttle of rclpy's loggers counts by line of code: there the first of two messages
    suppresses the second.
    """

    def __init__(self, say: Callable[[str], object], seconds: float = 1.0) -> None:
        self._log = say
        self._seconds = seconds
        self._logged: dict[str, float] = {}

    def __call__(self, message: str) -> None:
        """Log ``message``, unless it was logged recently."""
        now = monotonic()
        self._logged = {m: at for m, at in self._logged.items() if now - at < self._seconds}
        if message not in self._logged and len(self._logged) < _MOST:
            self._logged[message] = now
            self._log(message)
