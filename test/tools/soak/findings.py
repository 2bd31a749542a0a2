# SPDX-License-Identifier: Apache-2.0
"""The results of a long run in real time: memory, deadlines, messages and latency."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from kalman_ros.core import Array

#: Without a leak a slope is outside its interval in one case of N.
_ODDS = 1000.0
#: In bytes per second: 17 MB a day.
_GROWTH = 200.0
#: In bytes: heaps and queues may grow once after the warm-up.
_SETTLING = 0.25e6
#: Memory is averaged over N stretches, long enough to be nearly independent.
_STRETCHES = 20
#: The warm-up in seconds, except for short runs.
_WARM_UP = 60.0
#: Runs shorter than this, in seconds, cannot show a leak.
LEAST_MEMORY = 360.0
#: The number of checks over which the cause of a missed deadline is sought: its own, and the
#: one before, since a node reports misses a second later.
_LOOKS = 2


class Slope(NamedTuple):
    """The growth of a quantity per second, and the interval that contains the true slope."""

    value: float
    low: float
    high: float


def slope(time: Array, y: Array) -> Slope:
    """Return the slope of ``y`` (N,) over ``time`` (N,), by least squares over stretches.

    Memory is correlated: means over stretches scatter about a line, single values do not.
    """
    t, y = (
        np.array([part.mean() for part in np.array_split(values, min(_STRETCHES, len(values)))])
        for values in (time, y)
    )
    t = t - t.mean()
    value = float(t @ y / (t @ t))
    residual = y - y.mean() - value * t
    free = len(t) - 2
    std = np.sqrt(residual @ residual / free / (t @ t))
    reach = float(stdtrit(free, 1.0 - 0.5 / _ODDS) * std)
    return Slope(value, value - reach, value + reach)


class Delivery(NamedTuple):
    """The number of messages of a topic published by one node, and received by another.

    ``publishers`` is the number of publishers that the receiver has found on the topic.
    """

    topic: str
    receiver: str
    published: int
    received: int
    publishers: int = 1

    @property
    def fault(self) -> str:
        """The problem; '' if as many were received as published."""
        if self.published == self.received:
            return ''
        counts = f'{self.published} published, the {self.receiver} received {self.received}'
        if self.received < self.published:
            return f'{self.topic}: {counts}'
        others = self.publishers - 1
        why = (
            f'{others} more publisher{"s are" if others > 1 else " is"} on the topic'
            if others > 0
            else 'another publisher was on the topic, or the middleware delivered some twice'
        )
        return f'{self.topic}: {counts}, {self.received - self.published} more: {why}'


@dataclass(frozen=True)
class Soak:
    """A long run, checked once a second.

    Parameters
    ----------
    rate
        Steps of the loop per second.
    time
        Of each check (N,), in s.
    resident
        Memory of each node (N,), in bytes.
    missed
        Late steps so far (N,).
    withheld
        Seconds for which, so far, the machine kept the plant from running (N,).
    median, tail
        Of the times from a reading until the resulting input is received, since the check
        before: the median and the 99th percentile (N,), in s.
    latency
        The 50th, 90th and 99th percentile of all of them, in s.
    deliveries
        Of the topics between nodes.
    not_finite
        The topics with a NaN or an infinity.
    readings
        The number of readings received, fused, rejected and dropped.
    """

    rate: float
    time: Array
    resident: Mapping[str, Array]
    missed: Array
    withheld: Array
    median: Array
    tail: Array
    latency: tuple[float, float, float]
    deliveries: tuple[Delivery, ...]
    not_finite: tuple[str, ...]
    readings: tuple[int, int, int, int]

    @property
    def warm(self) -> Any:
        """Which checks are after the warm-up (N,)."""
        return self.time >= min(_WARM_UP, self.time[-1] / 3.0)

    @cached_property
    def growth(self) -> dict[str, Slope]:
        """The growth of each node's memory after the warm-up, in bytes per second."""
        warm = self.warm
        return {name: slope(self.time[warm], y[warm]) for name, y in self.resident.items()}

    @property
    def judges_memory(self) -> bool:
        """Whether the run was long enough to detect a leak."""
        time = self.time[self.warm]
        return bool(time[0] >= _WARM_UP and time[-1] - time[0] >= LEAST_MEMORY - _WARM_UP)

    @property
    def allowed_growth(self) -> float:
        """The allowed growth of memory after the warm-up, in bytes per second."""
        time = self.time[self.warm]
        return _GROWTH + _SETTLING / float(time[-1] - time[0])

    @property
    def unexplained(self) -> int:
        """Missed steps for which the machine did not delay the plant long enough.

        A plant that misses N steps was delayed for at least N periods.
        """
        missed = np.diff(self.missed, prepend=0.0)
        withheld = self.withheld - np.concatenate((np.zeros(_LOOKS), self.withheld[:-_LOOKS]))
        return int(np.sum(np.maximum(0.0, missed - np.ceil(withheld * self.rate))))

    @property
    def broken(self) -> list[str]:
        """The broken promises."""
        found = [
            f'the memory of the {name} grows by {each.value:.0f} bytes a second, '
            f'by {each.low:.0f} at least; {self.allowed_growth:.0f} are allowed'
            for name, each in self.growth.items()
            if self.judges_memory and each.low > self.allowed_growth
        ]
        if self.unexplained:
            found.append(f'{self.unexplained} steps were missed for no reason')
        found += [delivery.fault for delivery in self.deliveries if delivery.fault]
        if self.not_finite:
            found.append(f'{", ".join(self.not_finite)}: a number is not finite')
        came, *fates = self.readings
        if came != sum(fates):
            found.append(f'of {came} readings {sum(fates)} are accounted for')
        return found

    @property
    def promises(self) -> int:
        """The number of promises checked; each broken one occurs once in `broken`."""
        memory = len(self.resident) if self.judges_memory else 0
        always = len(('deadlines', 'finite', 'readings'))
        return memory + len(self.deliveries) + always

    @property
    def verdict(self) -> str:
        """PASS or FAIL with the number of promises that hold."""
        count = f'{self.promises - len(self.broken)} of {self.promises} promises'
        return f'FAIL, {count} hold' if self.broken else f'PASS, {count}: Every promise holds.'

    def summary(self) -> dict[str, Any]:
        """Return it for JSON, without the series."""
        came, fused, rejected, dropped = self.readings
        return {
            'seconds': float(self.time[-1]),
            'rate': self.rate,
            'growth': {name: each._asdict() for name, each in self.growth.items()},
            'allowed_growth': self.allowed_growth if self.judges_memory else None,
            'missed': int(self.missed[-1]),
            'unexplained': self.unexplained,
            'withheld': float(self.withheld[-1]),
            'latency': dict(zip(('50 %', '90 %', '99 %'), self.latency)),
            'deliveries': [each._asdict() for each in self.deliveries],
            'readings': {'came': came, 'fused': fused, 'rejected': rejected, 'dropped': dropped},
            'promises': self.promises,
            'broken': self.broken,
        }
