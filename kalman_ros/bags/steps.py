# SPDX-License-Identifier: Apache-2.0
"""The messages of a recording of lockstep, whose time is that of its ticks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import inf

from kalman_ros.codecs.messages import UndecodableError, leading_stamp

from .blocks import Message, as_published
from .budget import MOST_PENDING, MOST_WAITING


class Steps:
    """The messages of the steps between two times, in the order of cause and effect.

    The messages of a step are all those from the tick before it to its own tick. A run does not
    take the time that it simulates, so the clock of the recorder does not determine the steps.

    Parameters
    ----------
    messages
        Messages in the order in which they were received.
    tick
        Topic of the ticks.
    start, end
        Limits in simulated seconds from the first tick.

    Raises
    ------
    ValueError
        While iterating, if messages without a tick would fill the memory.
    """

    def __init__(
        self, messages: Iterable[Message], tick: str, start: float = 0.0, end: float = inf
    ) -> None:
        self._messages, self._tick, self._limits = messages, tick, (start * 1e9, end * 1e9)
        #: Stamp of the first tick, in nanoseconds; None before it.
        self.origin: int | None = None

    def __iter__(self) -> Iterator[Message]:
        """Yield the messages."""
        start, end = self._limits
        limited = start > 0.0 or end < inf
        waiting: list[Message] = []
        size = 0
        for message in as_published(self._messages):
            elapsed = self._elapsed(message)
            if not limited and not waiting and self.origin is not None:
                yield message
                continue
            waiting.append(message)
            size += len(message.data)
            if elapsed is None:
                if len(waiting) > MOST_WAITING or size > MOST_PENDING:
                    count = len(waiting)
                    raise ValueError(f'{count} messages without a tick on {self._tick}')
                continue
            if elapsed > end:
                return
            if elapsed >= start:
                yield from waiting
            waiting.clear()
            size = 0
        yield from waiting

    def _elapsed(self, message: Message) -> int | None:
        """Return the simulated time of a tick in nanoseconds; None for another message."""
        if message.topic != self._tick:
            return None
        try:
            time = leading_stamp(message.data)
        except UndecodableError:
            return None
        if self.origin is None:
            self.origin = time
        return time - self.origin
