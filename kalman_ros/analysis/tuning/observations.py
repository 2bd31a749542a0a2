# SPDX-License-Identifier: Apache-2.0
"""Readings and inputs of a recording as arrays, in the order in which a filter processes them."""

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
    """N readings of one sensor.

    Parameters
    ----------
    stamp
        Time at which each reading was taken, in nanoseconds (N,).
    value
        Values (N, k); a number that is not finite is missing.
    covariance
        Noise covariance of each reading (N, k, k); None for the covariance of the sensor.
    taken
        Whether a sensor took the readings. Innovations of zeros that are known without a sensor
        are not judged, since they do not scatter, but they count in the likelihood.
    """

    stamp: Stamps
    value: Array
    covariance: Array | None = None
    taken: bool = True


@dataclass(frozen=True)
class Observations:
    """The readings and inputs that an estimator receives.

    Parameters
    ----------
    readings
        Readings by sensor; readings of the same time are fused in this order.
    input_stamp, input
        Times in nanoseconds (M,) from which on the inputs (M, m) hold.
    """

    readings: Mapping[str, Readings]
    input_stamp: Stamps
    input: Array

    @property
    def count(self) -> int:
        """Number of finite values in all readings."""
        return sum(int(np.isfinite(readings.value).sum()) for readings in self.readings.values())

    @property
    def span(self) -> tuple[int, int]:
        """First and last stamp of a reading, in nanoseconds."""
        stamps = [readings.stamp for readings in self.readings.values() if len(readings.stamp)]
        return int(min(s.min() for s in stamps)), int(max(s.max() for s in stamps))

    @property
    def first(self) -> int:
        """First stamp of an input or a reading, in nanoseconds."""
        stamps = [*(readings.stamp for readings in self.readings.values()), self.input_stamp]
        return int(min(s.min() for s in stamps if len(s)))

    def until(self, share: float) -> int:
        """Return the stamp before which a ``share`` of the readings was taken, in nanoseconds."""
        stamps = np.concatenate([readings.stamp for readings in self.readings.values()])
        return int(np.quantile(stamps, share))

    def events(self, delays: Mapping[str, float], until: int | None = None) -> list[Event]:
        """Return readings and inputs in order of time, with readings earlier by ``delays`` (s).

        A reading precedes an input of the same time, which acts only from then on. Readings
        without a finite number, and readings after the stamp ``until``, are omitted.
        """
        times, orders, indices = [], [], []
        for order, (name, readings) in enumerate(self.readings.items()):
            use = np.isfinite(readings.value).any(axis=1)
            if until is not None:
                use &= readings.stamp <= until
            rows = np.flatnonzero(use)
            times.append(readings.stamp[rows] - round(delays.get(name, 0.0) * 1e9))
            orders.append(np.full(len(rows), order))
            indices.append(rows)
        last = max((int(stamps.max()) for stamps in times if len(stamps)), default=0)
        acting = np.flatnonzero(self.input_stamp < last)
        times.append(self.input_stamp[acting])
        orders.append(np.full(len(acting), len(self.readings)))
        indices.append(acting)
        columns = [np.concatenate(column) for column in (times, orders, indices)]
        by_time = np.lexsort((columns[1], columns[0]))
        return list(map(Event, *(column[by_time].tolist() for column in columns)))


class Event(NamedTuple):
    """A reading, or an input, at a ``time`` in nanoseconds.

    ``order`` is the index of the sensor, or the number of sensors for an input. ``row`` is the
    index of the reading of that sensor, or of the input.
    """

    time: int
    order: int
    row: int
