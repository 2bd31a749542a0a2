# SPDX-License-Identifier: Apache-2.0
"""The last belief of each instant, from the items that no later item can change."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from .filter import Filter
from .smoother import Filtered
from .timeline import Item


class Instants:
    """Items of one time are one instant, with the belief after the last of them."""

    def __init__(self) -> None:
        self._last: tuple[Filtered, Filter] | None = None

    def take(self, items: Iterable[Item]) -> Iterator[tuple[Filtered, Filter]]:
        """Yield the instants that are complete, each with the filter that made it."""
        for item in items:
            state, last = item.after, self._last
            if state.u is None:  # it rests until its first input
                continue
            time = item.key[0]
            restarted = item.restarted or last is None or time < last[0].time
            if last is not None and time == last[0].time:
                restarted |= last[0].restarted
            elif last is not None:
                yield last
            self._last = Filtered(time, state.belief, state.u, restarted), item.filter

    def finish(self) -> Iterator[tuple[Filtered, Filter]]:
        """Yield the last instant; the next one is independent of it."""
        if self._last is not None:
            yield self._last
        self._last = None
