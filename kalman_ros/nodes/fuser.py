# SPDX-License-Identifier: Apache-2.0
"""Fuses received readings and inputs, and counts the outcome of each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from operator import itemgetter
from typing import Any, NamedTuple

from kalman_ros.analysis.local_observability import ObservabilityMeter
from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.correction import Correction
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.scenario import Scenario

from .channel import Channel, InputChannel, SensorChannel
from .throttle import Throttle


class Received(NamedTuple):
    """A decoded message: its time in nanoseconds, its channel, and its content."""

    time: int
    channel: Channel
    sample: Sample


class Corrected(NamedTuple):
    """The correction by one reading, and the time at which it was taken."""

    channel: SensorChannel
    time: int
    correction: Correction


class Fuser:
    """Passes received messages to an `OnlineEstimator` and counts the outcomes.

    Parameters
    ----------
    node
        The node, which publishes the innovations and logs the warnings.
    scenario
        Names the sensors and the input.
    online
        The estimator.
    """

    def __init__(self, node: Any, scenario: Scenario, online: OnlineEstimator) -> None:
        self.online = online
        self.input = InputChannel(scenario.input)
        self.channels = {
            name: SensorChannel(node, name, source, scenario.state)
            for name, source in scenario.sensors.items()
        }
        for channel in self.channels.values():
            channel.nis.inside()  # it loads much the first time, 0.2 s of it
        #: Outcomes of the inputs.
        self.inputs: Counter[Outcome] = Counter()
        self.observability = ObservabilityMeter(scenario)
        self._input_topic = scenario.input.topic
        #: Logs a warning, at a limited rate.
        self.warn = Throttle(node.get_logger().warning)
        self._judged = online.restarts

    def fuse(self, received: Iterable[Received], now: int | None = None) -> list[Corrected]:
        """Fuse messages received by ``now`` and return the corrections by readings."""
        # in the order of the stamps: no message is too old because of another of the same batch
        batch = sorted(received, key=itemgetter(0))
        arrivals = [
            Arrival(channel.name, time, sample.values, sample.covariance)
            for time, channel, sample in batch
        ]
        corrections = []
        for (time, channel, sample), fate in zip(batch, self.online.add(arrivals, now)):
            outcome, correction = fate
            if isinstance(channel, SensorChannel):
                self._account_for_reading(channel, time, outcome)
                if correction is not None:
                    corrections.append(Corrected(channel, time, correction))
            else:
                self._account_for_input(time, sample.values, outcome)
        return corrections

    def _account_for_reading(self, channel: SensorChannel, time: int, outcome: Outcome) -> None:
        if outcome is Outcome.WRONG_SIZE:
            self.warn(f'reading of {channel.name} {outcome.value}: {channel.trouble}')
        elif outcome is not Outcome.FUSED:
            self.warn(f'reading of {channel.name} {outcome.value}')
        if outcome.accepted:
            self.observability.reading(channel.name, time)

    def _account_for_input(self, time: int, u: Array, outcome: Outcome) -> None:
        self.inputs[outcome] += 1
        if outcome.accepted:
            self.observability.input(time, u)
        if outcome is not Outcome.FUSED:
            self.warn(f'{self._input_topic} {outcome.value}')

    def overrun(self, channel: Channel, missed: int) -> None:
        """Count ``missed`` messages that were dropped because newer ones were waiting."""
        if missed:
            if channel.name is None:
                account, what = self.inputs, self._input_topic
            else:
                account, what = self.online.counts[channel.name], f'readings of {channel.name}'
            account[Outcome.OVERRUN] += missed
            self.warn(f'{what} {Outcome.OVERRUN.value}')

    def read_input(self, data: bytes) -> Sample | None:
        """Return the input in a message; None, with a warning, if there is none in it."""
        try:
            return self.input.read(data)
        except (LookupError, ValueError) as error:
            self.warn(f'{self._input_topic}: {error}')
            return None

    def publish_innovations(self, corrections: list[Corrected], most: int | None = None) -> None:
        """Publish the innovations, of more than ``most`` the newest ones."""
        for channel, _, correction in corrections:
            channel.judge(correction)
        for channel, time, correction in corrections[0 if most is None else -most :]:
            channel.publish(time, correction)

    def reset(self, belief: Gaussian) -> None:
        """Drop all messages and their statistics, and start from a belief; counts are kept."""
        self.online.reset(belief)
        self._reset_statistics()

    def restart(self) -> None:
        """Reset because time went back, and count it."""
        self.online.restart()
        self._reset_statistics()

    def check_restarts(self) -> None:
        """Reset the statistics if the estimator restarted by itself, as it does after a gap."""
        if self.online.restarts != self._judged:
            self._reset_statistics()

    def _reset_statistics(self) -> None:
        self._judged = self.online.restarts
        for channel in self.channels.values():
            channel.reset_statistics()
