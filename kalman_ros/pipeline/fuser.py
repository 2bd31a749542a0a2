# SPDX-License-Identifier: Apache-2.0
"""Fuses received readings and inputs, and counts the outcome of each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from operator import itemgetter
from typing import Any, NamedTuple, Union

import numpy as np

from kalman_ros.analysis.local_observability import ObservabilityMeter
from kalman_ros.codecs.layout import Sample
from kalman_ros.compiled.parts import NUMPY
from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import Estimation

from .input_timeout import InputTimeout
from .reading_reader import InputReader, OtherFrameError, Reading, SensorReader
from .throttle import Throttle

#: What a message is received on.
Channel = Union[SensorReader, InputReader]


class Received(NamedTuple):
    """A decoded message: its time in nanoseconds, its channel, and its content.

    ``refused`` is why a reading cannot be used, if so.
    """

    time: int
    channel: Channel
    sample: Sample | Reading
    refused: Outcome | None = None


class Fused(NamedTuple):
    """A reading with the time at which it was taken, its outcome, and its correction if any."""

    channel: Any
    time: int
    sample: Sample | Reading
    outcome: Outcome
    correction: Correction | None


class Fuser:
    """Passes received messages to an `OnlineEstimator` and counts the outcomes.

    Parameters
    ----------
    scenario
        Names the sensors and the input.
    online
        The estimator.
    channels, input
        What reads the messages of each sensor, and of the input.
    warn
        Logs a warning.
    timeout
        Ends inputs that are not renewed; none by default.
    arithmetic
        What computes the model and the sensors.
    """

    def __init__(
        self,
        scenario: Scenario,
        online: OnlineEstimator,
        channels: Mapping[str, Any],
        input: Any,
        warn: Callable[[str], object],
        timeout: InputTimeout | None = None,
        arithmetic: str = NUMPY,
    ) -> None:
        self.online = online
        self.timeout = timeout or InputTimeout(0.0, np.empty(0))
        self.channels, self.input = channels, input
        for channel in channels.values():
            channel.nis.inside()  # it loads much the first time, 0.2 s of it
        #: Outcomes of the inputs.
        self.inputs: Counter[Outcome] = Counter()
        self.observability = ObservabilityMeter(scenario)
        #: Logs a warning, at a limited rate.
        self.warn = Throttle(warn)
        self.scenario = scenario
        #: What computes the model and the sensors.
        self.arithmetic = arithmetic
        self._judged = online.restarts
        #: How often a person or a program has asked for another belief.
        self.resets = 0
        #: The stamp of the newest reading that moved the estimate, in nanoseconds.
        self.fused_at: int | None = None

    def configure(self, scenario: Scenario, found: Estimation) -> None:
        """Use a scenario that was changed live; its names and topics are the same."""
        self.online.configure(found.filter, found.sensors, found.policy)
        self.scenario, self.arithmetic = scenario, found.arithmetic
        self.observability.configure(scenario)

    def fuse(self, received: Iterable[Received], now: int | None = None) -> list[Fused]:
        """Fuse messages received by ``now`` and return what became of the readings."""
        # in the order of the stamps: no message is too old because of another of the same batch
        batch = sorted(received, key=itemgetter(0))
        arrivals = [
            Arrival(channel.name, time, sample.values, sample.covariance)
            for time, channel, sample, refused in batch
            if refused is None
        ]
        ended = self._ended_inputs(batch, now)
        found = []
        fates = iter(self.online.add([*ended, *arrivals], now)[len(ended) :])
        for time, channel, sample, refused in batch:
            outcome, correction = next(fates) if refused is None else (refused, None)
            if isinstance(channel, SensorReader):
                if refused is not None:
                    self.online.counts[channel.name][refused] += 1
                self._account_for_reading(channel, time, outcome)
                found.append(Fused(channel, time, sample, outcome, correction))
            else:
                self._account_for_input(time, sample.values, outcome)
        return found

    def predicted(self, time: int) -> Gaussian:
        """Return the belief at a ``time`` not before the newest stamp; nothing is kept."""
        return self.online.predicted(time, self.timeout.ending(time))

    def _ended_inputs(self, batch: Iterable[Received], now: int | None) -> list[Arrival]:
        """Return the idle inputs in place of those that end before a message of a batch."""
        ended = []
        for time, channel, _, refused in batch:
            if refused is None:
                # no stamp ahead of the clock ends an input
                ended += self.timeout.ended_by(time if now is None else min(time, now))
            if channel is self.input:
                self.timeout.on_input(time)
        return ended

    def _account_for_reading(self, channel: SensorReader, time: int, outcome: Outcome) -> None:
        if outcome not in (Outcome.FUSED, Outcome.MOVING):
            why = f': {channel.trouble}' if outcome.explained and channel.trouble else ''
            self.warn(f'reading of {channel.name} {outcome.value}{why}')
        if outcome.accepted:
            self.fused_at = time if self.fused_at is None else max(time, self.fused_at)
            self.observability.reading(channel.name, time)

    def _account_for_input(self, time: int, u: Array, outcome: Outcome) -> None:
        self.inputs[outcome] += 1
        if outcome.accepted:
            self.observability.input(time, u)
        # a repeated input is in effect already: two estimates of one time may agree on it
        if outcome not in (Outcome.FUSED, Outcome.DUPLICATE):
            self.warn(f'{self.scenario.input.topic} {outcome.value}')

    def overrun(self, channel: Channel, missed: int) -> None:
        """Count ``missed`` messages that were dropped because newer ones were waiting."""
        if missed:
            if channel.name is None:
                account, what = self.inputs, self.scenario.input.topic
            else:
                account, what = self.online.counts[channel.name], f'readings of {channel.name}'
            account[Outcome.OVERRUN] += missed
            self.warn(f'{what} {Outcome.OVERRUN.value}')

    def read_input(self, data: bytes) -> Sample | None:
        """Return the input in a message; None, with a warning, if there is none in it."""
        try:
            sample: Sample = self.input.read(data)
        except OtherFrameError as error:
            self.inputs[Outcome.OTHER_FRAME] += 1
            self.warn(f'{self.scenario.input.topic} {Outcome.OTHER_FRAME.value}: {error}')
            return None
        except (LookupError, ValueError) as error:
            self.warn(f'{self.scenario.input.topic}: {error}')
            return None
        return sample

    def judge(self, fused: Iterable[Fused]) -> list[Fused]:
        """Record the corrections, and return the readings that have one."""
        corrected = [each for each in fused if each.correction is not None]
        for channel, _, _, _, correction in corrected:
            channel.judge(correction)
        return corrected

    def estimate(self) -> Array:
        """Return the newest estimate (n,) of the model's own states."""
        return self.scenario.believed.own(self.online.belief).mean

    def reset(self, belief: Gaussian) -> None:
        """Drop all messages and their statistics, and start from a belief; counts are kept."""
        self.online.reset(belief)
        self.resets += 1
        self._reset_statistics()

    def restart(self) -> None:
        """Reset because time went back, and count it."""
        self.online.restart()
        self._reset_statistics()

    def check_restarts(self) -> None:
        """Reset the statistics if the estimator restarted on its own, as it does after a gap."""
        if self.online.restarts != self._judged:
            self._reset_statistics()

    def _reset_statistics(self) -> None:
        self._judged = self.online.restarts
        self.fused_at = None
        for channel in self.channels.values():
            channel.reset_statistics()
