# SPDX-License-Identifier: Apache-2.0
"""Agreement of the readings of a batch with the estimates, by sensor and member."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .agreement import Record, Records

#: Mask of the members of a batch (...,).
Mask = npt.NDArray[np.bool_]
#: Placeholder for a missing time or agreement.
NEVER = -1


class BatchRecords:
    """The `agreement.Records` of all members, as arrays (sensors, ...)."""

    def __init__(self, sensors: int, members: tuple[int, ...]) -> None:
        shape = (sensors, *members)
        self.time = np.full(shape, NEVER, dtype=np.int64)
        self.interval = np.zeros(shape, dtype=np.int64)
        self.agrees = np.full(shape, NEVER, dtype=np.int8)
        self.rejections = np.zeros(shape, dtype=np.int64)
        self.noise = np.ones(shape)

    def add(self, order: int, time: int, agrees: Any, members: Mask) -> None:
        """Add a reading of a sensor for some members, as `agreement.Record.after` does."""
        since = time - self.time[order]
        known = members & (self.time[order] != NEVER) & (since != 0)
        self.interval[order] = np.where(known, since, self.interval[order])
        self.time[order] = np.where(members, time, self.time[order])
        self.agrees[order] = np.where(members, agrees, self.agrees[order])
        count = np.where(agrees == 0, self.rejections[order] + 1, 0)
        self.rejections[order] = np.where(members, count, self.rejections[order])

    def of(self, at: tuple[int, ...]) -> Records:
        """Return the records of one member."""
        place = (slice(None), *at)
        columns = (column[place].tolist() for column in vars(self).values())
        return tuple(
            Record(
                None if time == NEVER else time,
                interval,
                None if agrees == NEVER else bool(agrees),
                rejections,
                noise,
            )
            for time, interval, agrees, rejections, noise in zip(*columns)
        )

    def set(self, at: tuple[int, ...], records: Records) -> None:
        """Replace the records of one member."""
        for order, record in enumerate(records):
            place = (order, *at)
            self.time[place] = NEVER if record.time is None else record.time
            self.interval[place] = record.interval
            self.agrees[place] = NEVER if record.agrees is None else record.agrees
            self.rejections[place] = record.rejections
            self.noise[place] = record.noise
