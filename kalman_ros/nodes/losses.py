# SPDX-License-Identifier: Apache-2.0
"""The messages that the middleware lost on their way to a subscription."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from rclpy.event_handler import QoSSubscriptionEventType, UnsupportedEventTypeError
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

#: The most writers of a topic that are distinguished.
_MOST = 16
#: Fast DDS counts losses in 32 bits with a sign; after messages of 20 MB its total was sometimes
#: -2147483647, as 64 bits. From here on it is no count.
_OVERFLOW = 2**31 - 1


class Losses:
    """Counts the losses of one subscription in two ways, neither of which is complete.

    The middleware counts gaps in the messages that arrive, but not those that its full queue then
    drops; writers number their messages, and gaps show those, too, except before the first message
    and after the last. Both are lower bounds, so the larger one counts.

    Parameters
    ----------
    subscription
        Of `rclpy`.
    """

    def __init__(self, subscription: Any) -> None:
        kind = QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST
        self._event: Any = None
        with suppress(UnsupportedEventTypeError), subscription.handle:
            self._event = _rclpy.EventHandle(subscription.handle, kind)
        #: The last number of each writer; the writer of a message is unknown, only its number.
        self._last: list[int] = []
        self._missing = self._count = 0

    def numbered(self, number: int | None) -> None:
        """Record a message with the ``number`` that its writer gave it.

        It is assigned to the writer with the closest earlier number. If it is another's, the sum
        of the gaps is still right, since the other's next message is then assigned to this one.
        """
        if not number:  # not every middleware has it
            return
        before = [last for last in self._last if last < number]
        if not before:
            self._last = [*self._last[1 - _MOST :], number]
            return
        last = max(before)
        self._last[self._last.index(last)] = number
        self._missing += number - last - 1

    @property
    def count(self) -> int:
        """The number of lost messages so far, at least."""
        by_middleware = 0
        if self._event is not None:
            with self._event:
                status = self._event.take_event()
            if status is not None and 0 <= status.total_count < _OVERFLOW:
                by_middleware = status.total_count
        self._count = max(self._count, by_middleware, self._missing)
        return self._count

    def close(self) -> None:
        """Release the event."""
        if self._event is not None:
            self._event.destroy_when_not_in_use()
            self._event = None
