# SPDX-License-Identifier: Apache-2.0
"""Fusion of received readings and inputs, with counts of their outcomes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from operator import attrgetter
from typing import Any, Union

import numpy as np

from kalman_ros.analysis.local_observability import ObservabilityMeter
from kalman_ros.compiled.parts import NUMPY
from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.arrivals import Arrivals, Taken
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import Estimation

from .input_timeout import InputTimeout
from .reading import Reading
from .reading_reader import InputReader, SensorReader, UnusableInputError
from .throttle import Throttle

#: Reader of the messages of a sensor, or of the input.
Channel = Union[SensorReader, InputReader]


class Fuser:
    """Fusion of received messages by an `OnlineEstimator`, with counts of the outcomes.

    Parameters
    ----------
    scenario
        Scenario with the sensors and the input.
    online
        Estimator that fuses the messages.
    channels, input
        Readers of the messages of each sensor, and of the input.
    warn
        Function that logs a warning.
    timeout
        Timeout of inputs that are not renewed; none by default.
    arithmetic
        Arithmetic that computes the model and the sensors.
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
            channel.nis.inside()  # the first call imports much, for 0.2 s
        #: Outcomes of the inputs.
        self.inputs: Counter[Outcome] = Counter()
        self.observability = ObservabilityMeter(scenario, online.filter.model, online.sensors)
        #: Logger of warnings, at a limited rate.
        self.warn = Throttle(warn)
        self.scenario = scenario
        #: Arithmetic that computes the model and the sensors.
        self.arithmetic = arithmetic
        self._judged = online.restarts
        #: Number of resets that a person or a program has requested.
        self.resets = 0
        #: Whether readings are fused; inputs always are, since the plant obeys them.
        self.fusing = True
        #: Stamp of the newest reading that moved the estimate, in nanoseconds.
        self.fused_at: int | None = None
        #: Function that is called once, before readings are fused again.
        self.before_next: Callable[[], object] | None = None

    def configure(self, scenario: Scenario, estimation: Estimation) -> None:
        """Use a scenario that was changed live, with the same names and topics."""
        self.online.configure(estimation.filter, estimation.sensors, estimation.policy)
        self.scenario, self.arithmetic = scenario, estimation.arithmetic
        self.observability.configure(scenario, estimation.filter.model, estimation.sensors)
        self.input.configure(scenario.input)

    def fuse(self, received: Iterable[Reading], now: int | None = None) -> list[Reading]:
        """Fuse readings and inputs received by ``now``; return the readings, with outcomes."""
        if self.before_next is not None:
            action, self.before_next = self.before_next, None
            action()
        # in the order of the stamps: no message is too old because of another of the same batch
        batch = sorted(received, key=attrgetter('time'))
        readings = [reading for reading in batch if reading.source is not None]
        if not self.fusing:
            for reading in readings:
                reading.outcome = Outcome.SWITCHED_OFF
        for reading in readings:
            if reading.outcome is not None:
                self.online.counts[reading.source][reading.outcome] += 1
        usable = [reading for reading in batch if reading.outcome is None]
        ended = self._ended_inputs(batch, now) if self.timeout.is_set else []
        results = self.online.add([*ended, *usable], now)[len(ended) :]
        for reading, result in zip(usable, results):
            reading.outcome, reading.correction = result
        for reading in batch:
            if reading.source is None:
                self._account_for_input(reading)
            else:
                self._account_for_reading(reading)
        return readings

    def fuse_first(self, arrivals: Arrivals) -> Taken | None:
        """Fuse those of many readings and inputs that need no decision, as `fuse` does, at once.

        Returns their results; None if it is not possible. Observability is not measured.
        """
        if self.before_next is not None or not self.fusing:
            return None
        acts = arrivals.source == len(arrivals.covariances)
        ready = self.timeout.before_end(arrivals.time, arrivals.now, acts)
        taken = self.online.add_first(arrivals.some(slice(ready)))
        if taken is None or not len(taken.time):
            return taken
        time, acts = arrivals.time[: len(taken.time)], acts[: len(taken.time)]
        if acts.any():
            self.inputs[Outcome.FUSED] += int(np.count_nonzero(acts))
            self.timeout.on_input(int(time[acts].max()))
        if not acts.all():
            newest = int(time[~acts].max())
            self.fused_at = newest if self.fused_at is None else max(newest, self.fused_at)
        return taken

    def predicted(self, time: int) -> Gaussian:
        """Return the belief at a ``time`` not before the newest stamp, without keeping it."""
        return self.online.predicted(time, self.timeout.ending(time))

    def _ended_inputs(self, batch: Iterable[Reading], now: int | None) -> list[Arrival]:
        """Return the idle inputs in place of the inputs that end before a message of a batch."""
        ended = []
        for reading in batch:
            if reading.outcome is None:
                # no stamp ahead of the clock ends an input
                time = reading.time
                ended += self.timeout.ended_by(time if now is None else min(time, now))
            if reading.source is None:
                self.timeout.on_input(reading.time)
        return ended

    def _account_for_reading(self, reading: Reading) -> None:
        name, time, outcome = reading.source, reading.time, reading.outcome
        if not outcome.intended:
            trouble = self.channels[name].trouble if outcome.explained else ''
            why = f': {trouble}' if trouble else ''
            self.warn(f'reading of {name} {outcome.value}{why}')
        if outcome.accepted:
            self.fused_at = time if self.fused_at is None else max(time, self.fused_at)
            self.observability.reading(name, time)

    def _account_for_input(self, reading: Reading) -> None:
        outcome = reading.outcome
        self.inputs[outcome] += 1
        if outcome.accepted:
            self.observability.input(reading.time, reading.values)
        # a repeated input is in effect already: two estimates of one time may agree on it
        if outcome not in (Outcome.FUSED, Outcome.DUPLICATE):
            self.warn(f'{self.scenario.input.topic} {outcome.value}')

    def overrun(self, channel: Channel, missed: int) -> None:
        """Count ``missed`` messages that were dropped because newer ones were waiting."""
        if missed:
            if channel.name is None:
                account, subject = self.inputs, self.scenario.input.topic
            else:
                account, subject = self.online.counts[channel.name], f'readings of {channel.name}'
            account[Outcome.OVERRUN] += missed
            self.warn(f'{subject} {Outcome.OVERRUN.value}')

    def read_input(self, data: bytes) -> Reading | None:
        """Return the input in a message, or None with a warning if the message has no input."""
        try:
            time, values, _ = self.input.read(data)
        except UnusableInputError as error:
            self.inputs[error.outcome] += 1
            self.warn(f'{self.scenario.input.topic} {error.outcome.value}: {error}')
            return None
        except (LookupError, ValueError) as error:
            self.inputs[Outcome.WRONG_SIZE] += 1
            self.warn(f'{self.scenario.input.topic}: {error}')
            return None
        return Reading(None, time, values)

    def judge(self, readings: Iterable[Reading]) -> list[Reading]:
        """Record the corrections, and return the readings with a correction."""
        corrected = [reading for reading in readings if reading.correction is not None]
        for reading in corrected:
            self.channels[reading.source].judge(reading.correction)
        return corrected

    def estimate(self) -> Array:
        """Return the newest estimate (n,), of the biases of sensors, too, if these are states."""
        return self.online.belief.mean

    def begin(self, belief: Gaussian) -> None:
        """Drop all messages and their statistics, and start from a belief; counts are kept."""
        self.online.reset(belief)
        self._reset_statistics()

    def reset(self, belief: Gaussian) -> None:
        """Begin again from a belief, as requested, and count it."""
        self.begin(belief)
        self.resets += 1

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
