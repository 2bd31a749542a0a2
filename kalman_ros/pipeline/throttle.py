# SPDX-License-Identifier: Apache-2.0
"""Warnings at a limited rate, each message separately."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

#: Largest number of remembered messages, since a hostile sender could create any number.
_MOST = 20
#: Seconds: the longest interval between two logs of a message that goes on, and the silence after
#: which it is a new one.
_LONGEST, _SILENCE = 600.0, 60.0


@dataclass
class _Repeated:
    """Times at which a message was last logged and last requested, and its waiting time."""

    logged: float
    asked: float
    wait: float


class Throttle:
    """Logger that repeats a message after N seconds, then after twice as many, and so on.

    So a receiver that has no fix for hours does not fill the log. The throttle of rclpy's loggers
    counts by line of code: there the first of two messages suppresses the second.
    """

    def __init__(self, say: Callable[[str], object], seconds: float = 1.0) -> None:
        self._log = say
        self._seconds = seconds
        self._messages: dict[str, _Repeated] = {}

    def __call__(self, message: str) -> None:
        """Log ``message``, unless it was logged recently."""
        now = monotonic()
        known = self._messages.get(message)
        if known is None or now - known.asked > _SILENCE:
            if known is None and not self._make_room(now):
                return
            self._messages[message] = _Repeated(now, now, self._seconds)
            self._log(message)
            return
        known.asked = now
        if now - known.logged >= known.wait:
            known.logged, known.wait = now, min(2.0 * known.wait, _LONGEST)
            self._log(message)

    def _make_room(self, now: float) -> bool:
        """Return whether another message may be remembered, without the most silent one."""
        if len(self._messages) < _MOST:
            return True
        silent = min(self._messages, key=lambda message: self._messages[message].asked)
        if now - self._messages[silent].asked < self._seconds:
            return False
        del self._messages[silent]
        return True
