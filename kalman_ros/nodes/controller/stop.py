# SPDX-License-Identifier: Apache-2.0
"""Whether a controller may act: it is enabled, and nothing has stopped it."""

from __future__ import annotations

from time import monotonic


class Stop:
    """A switch with a latch: once stopped, it takes a reset and then an enable to act again.

    Parameters
    ----------
    enabled
        Whether it may act at first.
    """

    def __init__(self, *, enabled: bool) -> None:
        self._enabled = enabled
        #: Why it is stopped; '' if it is not.
        self.reason = ''
        self._pressed = False

    @property
    def may_act(self) -> bool:
        """Whether inputs are computed."""
        return self._enabled

    def stop(self, reason: str) -> None:
        """Stop until `reset` and then `enable`; the first reason stays."""
        self._enabled = False
        self.reason = self.reason or reason

    def press(self, reason: str, *, on: bool) -> None:
        """Stop, and refuse a reset until the button is released, which alone ends nothing."""
        self._pressed = on
        if on:
            self.stop(reason)

    def reset(self) -> bool:
        """End a stop, and return whether that was done; it stays disabled."""
        if not self._pressed:
            self.reason = ''
        return not self._pressed

    def enable(self, *, on: bool) -> bool:
        """Enable or disable, and return whether that was done: a stop ends by `reset` alone."""
        if on and self.reason:
            return False
        self._enabled = on
        return True


class Heartbeat:
    """A message that must arrive again and again.

    Parameters
    ----------
    timeout
        The longest time between two in seconds; 0 for any.
    """

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self.beat()

    def beat(self) -> None:
        """Record that it has arrived."""
        self._last = monotonic()

    @property
    def problem(self) -> str:
        """Message of a late heartbeat; '' if it is in time."""
        silence = monotonic() - self._last
        if not self.timeout or silence <= self.timeout:
            return ''
        return f'no heartbeat for {silence:.2g} s'
