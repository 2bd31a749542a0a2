# SPDX-License-Identifier: Apache-2.0
"""The topics of the estimator: messages in, innovations out, and statistics of each sensor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from math import inf, isfinite
from time import monotonic
from typing import Any

from kalman_ros.core import Signal
from kalman_ros.core.geodesy import Origin
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.nodes.middleware.meters import Latency, Rate
from kalman_ros.nodes.middleware.watcher import waiting
from kalman_ros.pipeline.mounts import Mounts
from kalman_ros.pipeline.reading_reader import InputReader, SensorReader
from kalman_ros.scenario import SensorSource

from .host import EstimatorHost
from .publisher import InnovationPublisher

#: A sensor is silent after N seconds without a reading, or M of its intervals.
_SILENCE, _INTERVALS = 1.0, 5.0
#: Readings of which none is used are a problem after N seconds, or after M intervals as well.
_UNUSED = 3.0
#: Seconds by which stamps may be ahead of the clock: a simulated one ticks coarsely.
_AHEAD = 0.1
#: The most messages taken at once, in a few milliseconds. Of more, the oldest are dropped.
_MOST = 50


class Subscribed:
    """The messages waiting on one topic."""

    #: While the node is active.
    subscription: Any = None
    #: The full name of the topic.
    topic = ''

    def take(self, first: list[bytes]) -> tuple[list[bytes], int]:
        """Return the newest messages waiting, including the ``first`` ones.

        Also returns the number of older ones that were dropped.
        """
        come = waiting(self.subscription, first)
        missed = len(come) - _MOST
        return (come[missed:], missed) if missed > 0 else (come, 0)


class InputChannel(Subscribed, InputReader):
    """Reads the known input from its topic."""


class Use:
    """Whether readings of a sensor are used, and why they are not."""

    def __init__(self) -> None:
        self._counts: Counter[Outcome] = Counter()
        #: Time, by the steady clock, at which some reading was used, or set aside as intended.
        self._used = monotonic()
        self._why = ''

    def count(self, counts: Mapping[Outcome, int]) -> None:
        """Take the outcomes of all readings so far."""
        new = Counter(counts)
        new.subtract(self._counts)
        self._counts = Counter(counts)
        new = +new
        wanted = {outcome: n for outcome, n in new.items() if not outcome.intended}
        if any(outcome.accepted for outcome in new) or (new and not wanted):
            self._used, self._why = monotonic(), ''
        elif wanted:
            self._why = max(wanted, key=lambda outcome: wanted[outcome]).value

    def problem(self, rate: float) -> str:
        """Return why no reading has been used for too long, at its rate in Hz; '' otherwise."""
        unused = monotonic() - self._used > max(_UNUSED, _INTERVALS / rate)
        return self._why if unused else ''


class SensorChannel(Subscribed, SensorReader):
    """Reads a sensor's topic, publishes its innovations, and measures how it goes."""

    def __init__(
        self,
        node: EstimatorHost,
        name: str,
        source: SensorSource,
        state: Signal,
        origin: Origin,
        mounts: Mounts,
    ) -> None:
        frames = node.options.frame, node.options.child_frame
        super().__init__(name, source, origin, frames, node.get_logger().warning, mounts)
        self._publish = InnovationPublisher(node, state, name, source.sensor.output)
        self.rate, self.use = Rate(), Use()
        #: From the stamp of a reading to the publication of its estimate.
        self.age = Latency()
        #: By how many seconds every reading since the last report was ahead of the clock.
        self._lead = inf
        self.ahead = 0.0

    def publish(self, time: int, correction: Correction) -> None:
        """Publish the innovation of the reading taken at ``time``."""
        if isfinite(correction.nis):
            self._publish(time, correction)

    def measure_lead(self, time: int, now: int) -> None:
        """Record that a reading stamped ``time`` was received at ``now``, both in nanoseconds."""
        self._lead = min(self._lead, (time - now) * 1e-9)

    def silent(self, source: SensorSource) -> bool:
        """Return whether readings are missing for longer than chance explains."""
        timed = source.timed
        return timed.enabled and self.rate.silence > max(_SILENCE, _INTERVALS / timed.rate)

    def report(self, counts: Mapping[Outcome, int]) -> dict[str, Any]:
        """Return the diagnostics of the sensor, given the outcomes of its readings."""
        name = self.name
        # a single stamp proves nothing about a clock: the least lead of all does
        self.ahead = self._lead if _AHEAD < self._lead < inf else 0.0
        self._lead = inf
        self.use.count(counts)
        values: dict[str, Any] = {f'{name}: readings': sum(counts.values())}
        values.update({f'{name}: {outcome.value}': count for outcome, count in counts.items()})
        if self.trouble:
            values[f'{name}: last message that was not used'] = self.trouble
        values[f'{name}: rate [Hz]'] = self.rate.value
        if str(self.age):
            values[f'{name}: age when published, 50 / 90 / 99 % [ms]'] = str(self.age)
        values[f'{name}: NIS / expected'] = self.nis.mean
        if self.ahead:
            values[f'{name}: ahead of the clock [s]'] = self.ahead
        return values
