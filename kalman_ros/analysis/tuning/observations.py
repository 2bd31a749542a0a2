# SPDX-License-Identifier: Apache-2.0
"""Readings and inputs of a recording as arrays, in the order in which a filter takes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array

#: Times in nanoseconds (N,).
Stamps = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Readings:
    """The N readings of one sensor.

    Parameters
    ----------
    stamp
        When each was taken, in nanoseconds (N,).
    value
        (N, k); a number that is not finite is missing.
    covariance
        The noise covariance of each (N, k, k); None for that of the sensor.
    taken
        Whether a sensor took them. The innovations of zeros that are known without one are not
        judged, since they do not scatter; their likelihood says whether the model agrees.
    """

    stamp: Stamps
    value: Array
    covariance: Array | None = None
    taken: bool = True


@dataclass(frozen=True)
class Observations:
    """All that an estimator receives.

    Parameters
    ----------
    readings
        By sensor; those of one time are fused in this order.
    input_stamp, input
        From when on, in nanoseconds (M,), which input holds (M, m).
    """

    readings: Mapping[str, Readings]
    input_stamp: Stamps
    input: Array

    @property
    def count(self) -> int:
        """The number of finite numbers read."""
        return sum(int(np.isfinite(each.value).sum()) for each in self.readings.values())

    @property
    def span(self) -> tuple[int, int]:
        """The first and the last stamp of a reading, in nanoseconds."""
        stamps = [each.stamp for each in self.readings.values() if len(each.stamp)]
        return int(min(s.min() for s in stamps)), int(max(s.max() for s in stamps))

    @property
    def first(self) -> int:
        """The first stamp, in nanoseconds, of an input or a reading."""
        stamps = [*(each.stamp for each in self.readings.values()), self.input_stamp]
        return int(min(s.min() for s in stamps if len(s)))

    def until(self, share: float) -> int:
        """Return the stamp before which a ``share`` of the readings was taken."""
        stamps = np.concatenate([each.stamp for each in self.readings.values()])
        return int(np.quantile(stamps, share))

    def events(self, delays: Mapping[str, float], until: int | None = None) -> list[Event]:
        """Return the readings and inputs in order, readings dated earlier by their ``delays`` (s).

        A reading comes before an input of the same time, which acts only from then on. Readings
        without a finite number are left out, as are those after the stamp ``until``.
        """
        times, orders, indices = [], [], []
        for order, (name, each) in enumerate(self.readings.items()):
            use = np.isfinite(each.value).any(axis=1)
            if until is not None:
                use &= each.stamp <= until
            found = np.flatnonzero(use)
            times.append(each.stamp[found] - round(delays.get(name, 0.0) * 1e9))
            orders.append(np.full(len(found), order))
            indices.append(found)
        last = max((int(each.max()) for each in times if len(each)), default=0)
        acting = np.flatnonzero(self.input_stamp < last)
        times.append(self.input_stamp[acting])
        orders.append(np.full(len(acting), len(self.readings)))
        indices.append(acting)
        columns = [np.concatenate(each) for each in (times, orders, indices)]
        by_time = np.lexsort((columns[1], columns[0]))
        return list(map(Event, *(each[by_time].tolist() for each in columns)))


class Event(NamedTuple):
    """A reading, or an input, at a ``time`` in nanoseconds.

    ``order`` is the place of the sensor among all, the number of sensors for an input; ``row``
    is which of its.
    """

    time: int
    order: int
    row: int
