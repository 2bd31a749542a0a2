# SPDX-License-Identifier: Apache-2.0
"""Warnings that do not flood a terminal, of which none hides another."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

#: So many different things are said within the time; a hostile sender could make up any number.
_MOST = 20


class Throttle:
    """Logs each message at most once within N seconds.

    The throttle of rclpy's loggers counts by line of code: there the first of two complaints
    silences the second.
    """

    def __init__(self, say: Callable[[str], object], seconds: float = 1.0) -> None:
        self._say = say
        self._seconds = seconds
        self._said: dict[str, float] = {}

    def __call__(self, message: str) -> None:
        """Say ``message``, unless it was said just now."""
        now = monotonic()
        self._said = {m: at for m, at in self._said.items() if now - at < self._seconds}
        if message not in self._said and len(self._said) < _MOST:
            self._said[message] = now
            self._say(message)
