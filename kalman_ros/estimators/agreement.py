# SPDX-License-Identifier: Apache-2.0
"""Which is wrong when a reading is rejected: its sensor, or the estimate.

The rule:

1. The last reading of a sensor either agrees with the estimate or contradicts it, and counts
until the sensor has not been received for ten of its intervals, and at least for a second.
2. A state is *vouched for* while some of the sensors that see it agree, at least half as many as
   contradict; no rejected reading widens the covariance of such a state.
3. Other states are widened, until the reading passes, once the sensors that see them have rejected
``recover_after`` readings in a row, in total; each of several sensors has to contribute, since
none counts for more than half of the total.

A single sensor therefore recovers after ``recover_after`` rejections; of two that see
the same states, the one that contradicts the estimate stays rejected; and an estimate that nearly
all contradict is widened. A sensor sees the states by which its reading has a derivative: a
gyroscope that agrees does not vouch for a position.

Limits of the rule: when two sensors both contradict the estimate, or one joins after the other, it
cannot decide which is right; the estimate stays with the first. A majority of sensors with the
same wrong reading is believed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Gaussian, Sensor

#: A sensor without readings for longer than all of these does not count: ns, and its intervals.
_SILENCE, _INTERVALS = 1_000_000_000, 10


class Record(NamedTuple):
    """How the readings of a sensor compared with the estimate, up to the last of them.

    Parameters
    ----------
    time
        The stamp of that reading in nanoseconds; None before the first.
    interval
        The nanoseconds between the last two; 0 before the second.
    agrees
        Whether it passed its gate; None if that is not informative.
    rejections
        The number of consecutive readings that did not.
    """

    time: int | None = None
    interval: int = 0
    agrees: bool | None = None
    rejections: int = 0

    def after(self, time: int, agrees: bool | None) -> Record:
        """Return the record after another reading."""
        interval = self.interval if self.time is None else time - self.time or self.interval
        return Record(time, interval, agrees, self.rejections + 1 if agrees is False else 0)

    def is_expected(self, now: int, longest: float = inf) -> bool:
        """Return whether another reading is expected; not after ``longest`` ns without one."""
        if self.time is None:
            return False
        silence = max(_SILENCE, _INTERVALS * self.interval) if self.interval else inf
        return now - self.time <= min(silence, longest)


Records = tuple[Record, ...]
#: States, as booleans (n,), or those of each sensor (sensors, n).
Mask = npt.NDArray[np.bool_]


def replaced(records: Records, index: int, record: Record) -> Records:
    """Return the records with another one at ``index``."""
    return (*records[:index], record, *records[index + 1 :])


def after_recovery(records: Records, seen: Mask, widened: Mask) -> Records:
    """Return the records after a recovery: sensors that see a ``widened`` state (n,) restart."""
    return tuple(
        Record(record.time, record.interval) if np.any(sees & widened) else record
        for record, sees in zip(records, seen)
    )


def seen_states(sensors: Mapping[str, Sensor], belief: Gaussian) -> Mask:
    """Return which states (n,) each sensor sees, as rows of booleans.

    A derivative may vanish at one point, as that of a bearing along an axis, so two are tested.
    """
    points = belief.mean, belief.mean + belief.std
    return np.array(
        [
            np.logical_or.reduce([np.any(each.jacobian(x) != 0.0, axis=0) for x in points])
            for each in sensors.values()
        ]
    )


class Finding(NamedTuple):
    """The consequences of a rejected reading.

    Parameters
    ----------
    vouched
        The states that other sensors vouch for (n,), as booleans.
    outvoted
        Whether all states that the sensor sees are vouched for.
    enough
        Whether enough readings were rejected to widen the others.
    """

    vouched: Mask
    outvoted: bool
    enough: bool


def judge(
    records: Sequence[Record],
    seen: Mask,
    index: int,
    recover_after: int,
    longest: float = inf,
) -> Finding:
    """Judge the last reading of the sensor at ``index``, which its gate rejected.

    Parameters
    ----------
    records
        Of every sensor, including the rejected reading.
    seen
        The states that each sensor sees (sensors, n), as booleans.
    index
        The sensor.
    recover_after
        The number of rejections after which a state is doubted.
    longest
        The longest silence in nanoseconds after which any sensor still counts.
    """
    now = records[index].time
    assert now is not None
    alive = np.array([record.is_expected(now, longest) for record in records])
    agreeing = seen[alive & [record.agrees is True for record in records]].sum(axis=0)
    contradicting = seen[alive & [record.agrees is False for record in records]].sum(axis=0)
    vouched = (agreeing > 0) & (2 * agreeing >= contradicting)
    doubted = seen[index] & ~vouched
    involved = alive & seen[:, doubted].any(axis=1)
    share = recover_after if involved.sum() < 2 else (recover_after + 1) // 2
    counting = (record for record, counts in zip(records, involved.tolist()) if counts)
    total = sum(min(record.rejections, share) for record in counting)
    return Finding(vouched, not doubted.any(), total >= recover_after)
