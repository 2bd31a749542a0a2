# SPDX-License-Identifier: Apache-2.0
"""The topics of the estimator: messages in, innovations out, and statistics of each sensor."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite
from typing import Any

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Signal
from kalman_ros.estimators.consistency import ChiSquareWindow
from kalman_ros.estimators.correction import Correction
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.scenario import SensorSource

from .estimate_publisher import InnovationPublisher
from .meters import Latency, Rate
from .reading_reader import ReadingReader
from .topics import innovation_signal
from .watcher import waiting

#: A sensor is silent after N seconds without a reading, or M of its intervals.
_SILENCE, _INTERVALS = 1.0, 5.0
#: Seconds by which stamps may be ahead of the clock by themselves: a simulated one ticks coarsely.
_AHEAD = 0.1
#: So many are taken in at once, in a few milliseconds. Of more, the oldest are dropped.
_MOST = 50


class Channel:
    """Messages of one topic, all that have come at a time."""

    #: Of the sensor; None if it is no sensor's.
    name: str | None = None
    #: While the node is active.
    subscription: Any = None

    @property
    def topic(self) -> str:
        """The full name of the topic."""
        return str(self.subscription.topic_name)

    def take(self, first: list[bytes]) -> tuple[list[bytes], int]:
        """Return the newest messages that have come, the ``first`` ones and those that wait.

        Beside them, how many older ones are left out.
        """
        come = first + waiting(self.subscription)
        missed = len(come) - _MOST
        return (come[missed:], missed) if missed > 0 else (come, 0)


class InputChannel(Channel):
    """Reads the known input."""

    def __init__(self, signal: Signal) -> None:
        self.read = WireReader(SignalCodec(signal))
        self.message_type = self.read.message_type


class SensorChannel(Channel):
    """Reads a sensor's messages, publishes what they said, and measures how it goes."""

    def __init__(self, node: Any, name: str, source: SensorSource, state: Signal) -> None:
        output = source.sensor.output
        self.name: str = name
        self._read = ReadingReader(source.signal)
        self.message_type = self._read.message_type
        self._publish = InnovationPublisher(node, innovation_signal(state, name, output))
        self.nis = ChiSquareWindow(output.size)
        self._rate = Rate()
        #: From the stamp of a reading until the estimate with it is out.
        self.age = Latency()
        #: By how many seconds every reading since the last report was ahead of the clock.
        self._lead = inf
        self.ahead = 0.0

    def reset_statistics(self) -> None:
        """Judge only the innovations from now on."""
        self.nis = ChiSquareWindow(self.nis.degrees)

    def read(self, data: bytes, source: SensorSource) -> Sample:
        """Return the reading in a message; UndecodableError if there is none."""
        reading = self._read(data, source)
        self._rate.count()
        return reading

    @property
    def trouble(self) -> str:
        """Why the last message that could not be read could not: the field and the sizes."""
        return self._read.trouble

    def judge(self, correction: Correction) -> None:
        """Take note of what a reading did, to judge whether innovations scatter as expected."""
        if isfinite(correction.nis):
            self.nis.add(correction.nis)

    def publish(self, time: int, correction: Correction) -> None:
        """Publish the innovation of the reading taken at ``time``."""
        if isfinite(correction.nis):
            self._publish(time, correction)

    def measure_lead(self, time: int, now: int) -> None:
        """Take note that a reading stamped ``time`` came at ``now``, both in nanoseconds."""
        self._lead = min(self._lead, (time - now) * 1e-9)

    def silent(self, source: SensorSource) -> bool:
        """Tell whether no reading has come for longer than can be by chance."""
        timed = source.timed
        return timed.enabled and self._rate.silence > max(_SILENCE, _INTERVALS / timed.rate)

    def report(self, counts: Mapping[Outcome, int]) -> dict[str, Any]:
        """Return what is to be said of the sensor, given what became of its readings."""
        name = self.name
        # one stray stamp says nothing of a clock: the least of all does
        self.ahead = self._lead if _AHEAD < self._lead < inf else 0.0
        self._lead = inf
        values: dict[str, Any] = {f'{name}: readings': sum(counts.values())}
        values.update({f'{name}: {outcome.value}': count for outcome, count in counts.items()})
        if self.trouble:
            values[f'{name}: last message that could not be read'] = self.trouble
        values[f'{name}: rate [Hz]'] = self._rate.value
        if str(self.age):
            values[f'{name}: age when published, 50 / 90 / 99 % [ms]'] = str(self.age)
        values[f'{name}: NIS / expected'] = self.nis.mean
        if self.ahead:
            values[f'{name}: ahead of the clock [s]'] = self.ahead
        return values
