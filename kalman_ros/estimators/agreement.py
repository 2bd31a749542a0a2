# SPDX-License-Identifier: Apache-2.0
"""The decision whether the sensor or the estimate is wrong when a reading is rejected.

The rule:

1. The last reading of a sensor either agrees with the estimate or contradicts it. It counts until
   nothing has been received from the sensor for ten of its intervals, and for at least a second.
2. A state is *vouched for* while the sensors that agree, of those that see it, are at least half
   as many as the sensors that contradict, and at least one. No rejected reading widens the
   covariance of such a state.
3. Other states are widened until the reading passes, once ``recover_after`` readings in a row, in
   total, of the sensors that see them were rejected. Each of several sensors has to contribute,
   since none counts for more than half of the total.

A single sensor therefore recovers after ``recover_after`` rejections. Of two sensors that see the
same states, the one that contradicts the estimate stays rejected. An estimate that nearly all
sensors contradict is widened. A sensor sees the states on which its reading depends, by the
Jacobian: a gyroscope that agrees does not vouch for a position.

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

#: A sensor does not count after a silence longer than both: in ns, and in its intervals.
_SILENCE, _INTERVALS = 1_000_000_000, 10


class Record(NamedTuple):
    """Agreement of the readings of a sensor with the estimate, up to the last reading.

    Parameters
    ----------
    time
        Stamp of the last reading in nanoseconds; None before the first reading.
    interval
        Nanoseconds between the last two readings; 0 before the second reading.
    agrees
        Whether the last reading passed its gate; None if that is not informative.
    rejections
        Number of consecutive readings that did not pass.
    noise
        Factor of the covariance of its noise, as far as it is adapted (`reading_noise`).
    """

    time: int | None = None
    interval: int = 0
    agrees: bool | None = None
    rejections: int = 0
    noise: float = 1.0

    def after(self, time: int, agrees: bool | None) -> Record:
        """Return the record after another reading."""
        interval = self.interval if self.time is None else time - self.time or self.interval
        rejections = self.rejections + 1 if agrees is False else 0
        return Record(time, interval, agrees, rejections, self.noise)

    def is_expected(self, now: int, longest: float = inf) -> bool:
        """Return whether another reading is expected: not after ``longest`` ns without one."""
        if self.time is None:
            return False
        silence = max(_SILENCE, _INTERVALS * self.interval) if self.interval else inf
        return now - self.time <= min(silence, longest)


Records = tuple[Record, ...]
#: Mask of states (n,), or of the states of several sensors (sensors, n).
Mask = npt.NDArray[np.bool_]


def replaced(records: Records, index: int, record: Record) -> Records:
    """Return the records with ``record`` at ``index``."""
    return (*records[:index], record, *records[index + 1 :])


def with_declared_noise(records: Records) -> Records:
    """Return the records without what readings have shown of the noise."""
    return tuple(record._replace(noise=1.0) for record in records)


def after_recovery(records: Records, seen: Mask, widened: Mask) -> Records:
    """Restart the records of the sensors that see a ``widened`` state (n,), after a recovery."""
    return tuple(
        Record(record.time, record.interval) if np.any(sees & widened) else record
        for record, sees in zip(records, seen)
    )


def seen_states(sensors: Mapping[str, Sensor], belief: Gaussian) -> Mask:
    """Return the mask (sensors, n) of the states that each sensor sees.

    A derivative may vanish at one point, as for a bearing along an axis, so two are tested.
    """
    points = belief.mean, belief.mean + belief.std
    return np.array(
        [
            np.logical_or.reduce([np.any(sensor.jacobian(x) != 0.0, axis=0) for x in points])
            for sensor in sensors.values()
        ]
    )


class Finding(NamedTuple):
    """The consequences of a rejected reading.

    Parameters
    ----------
    vouched
        Mask (n,) of the states that other sensors vouch for.
    outvoted
        Whether other sensors vouch for all states that the sensor sees.
    enough
        Whether enough readings were rejected to widen the other states.
    """

    vouched: Mask
    outvoted: bool
    enough: bool


def judge(
    records: Sequence[Record], seen: Mask, index: int, recover_after: int, longest: float = inf
) -> Finding:
    """Judge the last reading of the sensor at ``index``, which its gate rejected.

    Parameters
    ----------
    records
        Records of all sensors, including the rejected reading.
    seen
        Mask (sensors, n) of the states that each sensor sees.
    index
        Index of the sensor.
    recover_after
        Number of rejections after which a state is doubted.
    longest
        Longest silence in nanoseconds after which a sensor still counts.
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
