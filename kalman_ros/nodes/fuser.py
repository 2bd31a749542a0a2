# SPDX-License-Identifier: Apache-2.0
"""What the estimator makes of readings and inputs, with an account of each."""

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


class Come(NamedTuple):
    """What has come: its time in nanoseconds, whence, and what it says."""

    time: int
    channel: Channel
    sample: Sample


class Corrected(NamedTuple):
    """What the reading of a sensor, taken at a time, did to the belief."""

    channel: SensorChannel
    time: int
    correction: Correction


class Fuser:
    """Gives an `OnlineEstimator` what has come, and keeps account of what becomes of it.

    Parameters
    ----------
    node
        The node, which publishes innovations and says what is wrong.
    scenario
        Its sensors and its input.
    online
        What fuses.
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
        #: What became of the inputs.
        self.inputs: Counter[Outcome] = Counter()
        self.observability = ObservabilityMeter(scenario)
        self._input_topic = scenario.input.topic
        #: Says what is wrong, each once in a while.
        self.warn = Throttle(node.get_logger().warning)
        self._judged = online.restarts

    def fuse(self, come: Iterable[Come], now: int | None = None) -> list[Corrected]:
        """Fuse what came by ``now``, and return the corrections by readings."""
        # in the order of the stamps: what comes with something later is not too old beside it
        come = sorted(come, key=itemgetter(0))
        arrivals = [
            Arrival(channel.name, time, sample.values, sample.covariance)
            for time, channel, sample in come
        ]
        corrections = []
        for (time, channel, sample), fate in zip(come, self.online.add(arrivals, now)):
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
        """Take note that so many messages came for which there was no time."""
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

    def tell(self, corrections: list[Corrected], most: int | None = None) -> None:
        """Publish the innovations, and of many at most so many, the newest."""
        for channel, _, correction in corrections:
            channel.judge(correction)
        for channel, time, correction in corrections[0 if most is None else -most :]:
            channel.publish(time, correction)

    def start_anew(self, belief: Gaussian) -> None:
        """Forget what came, with what it said of the filter; counts go on."""
        self.online.reset(belief)
        self._judge_anew()

    def restart(self) -> None:
        """Forget what came, for time went back, and count that."""
        self.online.restart()
        self._judge_anew()

    def look_at_restarts(self) -> None:
        """Judge innovations anew if the estimator restarted by itself, after a gap for one."""
        if self.online.restarts != self._judged:
            self._judge_anew()

    def _judge_anew(self) -> None:
        self._judged = self.online.restarts
        for channel in self.channels.values():
            channel.start_anew()
