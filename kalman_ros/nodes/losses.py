# SPDX-License-Identifier: Apache-2.0
"""How many messages the middleware gave up on their way to a subscription."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from rclpy.event_handler import QoSSubscriptionEventType, UnsupportedEventTypeError
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

#: So many writers of a topic are told apart.
_MOST = 16


class Losses:
    """Counts what one subscription lost, in two ways of which neither sees all.

    The middleware counts the gaps that it finds in what arrives. What its full queue then drops
    it does not count; but messages are numbered by their writers, and where they are taken with
    their number, gaps show. Both say too little rather than too much, so the larger one counts.

    Parameters
    ----------
    subscription
        That of `rclpy`.
    """

    def __init__(self, subscription: Any) -> None:
        kind = QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST
        self._event: Any = None
        with suppress(UnsupportedEventTypeError), subscription.handle:
            self._event = _rclpy.EventHandle(subscription.handle, kind)
        #: The last number of each writer; who wrote a message is not known, only its number.
        self._last: list[int] = []
        self._missing = self._unnumbered = self._count = 0

    def unnumbered(self) -> None:
        """Take note of a message of which the number is not known."""
        self._unnumbered += 1

    def numbered(self, number: int | None) -> None:
        """Take note of a message with the ``number`` that its writer gave it.

        It is taken for one of the writer that had come nearest to it. If it is another's, the
        sum of the gaps is still right, for the other one's next message is then taken for its.
        """
        if not number:  # not every middleware tells
            return
        before = [last for last in self._last if last < number]
        if not before:
            if not self._last:
                self._unnumbered = 0
            self._last = [*self._last[1 - _MOST :], number]
            return
        last = max(before)
        self._last[self._last.index(last)] = number
        self._missing += number - last - 1

    @property
    def count(self) -> int:
        """How many messages were lost so far, at least."""
        by_middleware = 0
        if self._event is not None:
            with self._event:
                status = self._event.take_event()
            by_middleware = 0 if status is None else status.total_count
        self._count = max(self._count, by_middleware, self._missing - self._unnumbered)
        return self._count

    def close(self) -> None:
        """Give the event back."""
        if self._event is not None:
            self._event.destroy_when_not_in_use()
            self._event = None
