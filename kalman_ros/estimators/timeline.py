# SPDX-License-Identifier: Apache-2.0
"""The items received within a window, ordered by stamp, each with the estimator state after it."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor

from . import agreement
from .filter import Correction, Filter
from .outcome import Outcome

#: The fewest items that leave a window together.
_TOGETHER = 17


class State(NamedTuple):
    """The belief at a time, the input in effect from then on, and the outcomes by sensor.

    The input is None while the system is at rest. ``repairs`` counts the covariances on the way to
    this state that rounding made indefinite and that were repaired.
    """

    time: int | None
    belief: Gaussian
    u: Array | None
    records: agreement.Records
    repairs: int = 0


class Arrival:
    """A reading (k,) of a sensor, or an input (m,) with the ``source`` None, and its stamp.

    ``covariance`` (k, k) is the covariance in the message, if it has one.
    """

    __slots__ = 'covariance', 'source', 'time', 'values'

    def __init__(
        self, source: str | None, time: int, values: Array, covariance: Array | None = None
    ) -> None:
        self.source, self.time, self.values, self.covariance = source, time, values, covariance


class Item:
    """A reading, or an input (``sensor`` None), and the estimator state after it.

    The item keeps the filter and the sensor in use when it was received. A reading has no outcome
    before it is processed.
    """

    __slots__ = (
        'after', 'correction', 'filter', 'key', 'outcome', 'restarted', 'sensor', 'value'
    )  # fmt: skip

    def __init__(
        self, key: tuple[int, int, int], value: Array, sensor: Sensor | None, filter: Filter
    ) -> None:
        self.key = key
        self.value = value
        self.sensor = sensor
        self.filter = filter
        self.outcome: Outcome | None = None if sensor else Outcome.FUSED
        self.restarted = False
        self.correction: Correction | None = None
        self.after: State

    @property
    def fate(self) -> tuple[Outcome, Correction | None]:
        """The outcome and the correction of a processed item."""
        assert self.outcome is not None
        return self.outcome, self.correction


class Timeline:
    """Items ordered by stamp, in any order of arrival.

    Parameters
    ----------
    base
        Estimator state before the first item.
    """

    def __init__(self, base: State) -> None:
        self._base = base
        self._items: list[Item] = []
        #: The number of processed items, counted from the oldest.
        self._settled = 0

    @property
    def head(self) -> State:
        """The estimator state after the newest item."""
        return self._items[-1].after if self._items else self._base

    @property
    def last(self) -> tuple[int, int] | None:
        """Stamp and order of the newest item; None if there is none."""
        return self._items[-1].key[:2] if self._items else None

    def extend(self, items: list[Item], *, whole: bool) -> None:
        """Append processed items behind all others.

        They are the ``whole``, or those behind the window and one before it, which stands for all
        before.
        """
        if not whole:
            self._base, self._items = items[0].after, []
            items = items[1:]
        self._items += items
        self._settled = len(self._items)

    def insert(self, item: Item, window: int) -> Outcome | None:
        """Insert an item by its stamp; return the outcome if that is impossible.

        The item may be older than the newest one by at most ``window``, in nanoseconds.
        """
        items = self._items
        if not items or item.key > items[-1].key:
            items.append(item)
            return None
        time, base = item.key[0], self._base.time
        # a wider window does not bring back items before the base
        if time < items[-1].key[0] - window or (base is not None and time < base):
            return Outcome.TOO_OLD
        index = bisect_left(items, item.key, key=lambda other: other.key)
        if items[index].key == item.key:
            if item.sensor is not None or np.array_equal(items[index].value, item.value):
                return Outcome.DUPLICATE
            del items[index]
        items.insert(index, item)
        self._settled = min(self._settled, index)
        return None

    def settle(
        self, process: Callable[[Item, State], State]
    ) -> Iterator[tuple[Item, Outcome | None]]:
        """Process the inserted items, and process the items after them again.

        Yields each processed item with its previous outcome.
        """
        items, start = self._items, self._settled
        state = items[start - 1].after if start else self._base
        for item in items[start:]:
            before = item.outcome
            try:
                state = process(item, state)
            except Exception:  # raised by a model; the other items stay
                del items[self._settled]
                raise
            self._settled += 1
            yield item, before

    def forget(self, window: int) -> list[Item]:
        """Drop items older than the window; the state after the last of them becomes the base.

        Returns the items that were dropped.
        """
        items, fewest = self._items, _TOGETHER if window else 1
        if len(items) <= fewest:
            return []
        oldest = items[-1].key[0] - window
        if items[fewest - 1].key[0] >= oldest:
            return []
        gone = fewest
        while gone < len(items) - 1 and items[gone].key[0] < oldest:
            gone += 1
        return self._drop(gone)

    def drain(self) -> list[Item]:
        """Drop all processed items, as `forget` does."""
        return self._drop(self._settled)

    def _drop(self, count: int) -> list[Item]:
        dropped = self._items[:count]
        if dropped:
            self._base = dropped[-1].after
            del self._items[:count]
            self._settled -= count
        return dropped
