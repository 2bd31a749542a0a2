# SPDX-License-Identifier: Apache-2.0
"""The messages that the middleware lost on their way to a subscription."""

from __future__ import annotations

from typing import Any

from . import private

#: The most writers of a topic that are distinguished.
_MOST = 16
#: Fast DDS counts losses in 32 bits with a sign; after messages of 20 MB its total was sometimes
#: -2147483647, as 64 bits. From here on it is no count.
_OVERFLOW = 2**31 - 1


class Losses:
    """Counts the losses of one subscription in two ways, neither of which is complete.

    The middleware counts gaps in the messages that arrive, but not those that its full queue then
    drops; writers number their messages, so gaps in the numbers show those. Both are lower bounds,
    so the larger one counts.

    Parameters
    ----------
    subscription
        Of `rclpy`.
    """

    def __init__(self, subscription: Any) -> None:
        self._event = private.losses_of(subscription)
        #: The last number of each writer; the writer of a message is unknown, only its number.
        self._last: list[int] = []
        #: The numbers before and after each gap.
        self._gaps: list[tuple[int, int]] = []
        self._missing = self._by_middleware = 0

    def numbered(self, number: int | None) -> None:
        """Record a message with the ``number`` that its writer gave it.

        It follows the closest earlier number, which is the last of a writer, or the one before a
        gap: then what is after that gap belongs to another writer, and was its first message here.
        """
        if not number:  # not every middleware has it
            return
        if number - 1 in self._last:  # nothing is missing: almost always, and quick
            self._last[self._last.index(number - 1)] = number
            return
        last = max((earlier for earlier in self._last if earlier < number), default=0)
        gap = max((pair for pair in self._gaps if pair[0] < number < pair[1]), default=(0, 0))
        if gap[0] > last:
            self._close(gap)
            self._follow(gap[0], number)
        elif last:
            self._last.remove(last)
            self._follow(last, number)
        self._last = [*self._last[1 - _MOST :], number]

    def _follow(self, last: int, number: int) -> None:
        """Count what is missing between two messages of a writer."""
        if number - last > 1:
            self._missing += number - last - 1
            self._gaps = [*self._gaps[1 - _MOST :], (last, number)]

    def _close(self, gap: tuple[int, int]) -> None:
        """Count the messages in a gap as none of its writer's."""
        self._gaps.remove(gap)
        self._missing -= gap[1] - gap[0] - 1

    @property
    def count(self) -> int:
        """The number of lost messages so far, at least."""
        if self._event is not None:
            with self._event:
                status = self._event.take_event()
            if status is not None and 0 <= status.total_count < _OVERFLOW:
                self._by_middleware = max(self._by_middleware, status.total_count)
        return max(self._by_middleware, self._missing)

    def close(self) -> None:
        """Release the event."""
        if self._event is not None:
            self._event.destroy_when_not_in_use()
            self._event = None
