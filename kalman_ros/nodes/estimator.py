# SPDX-License-Identifier: Apache-2.0
"""The estimator: readings and forces in, the state with its covariance out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, Optional

import numpy as np
from sensor_msgs.msg import TimeReference
from std_srvs.srv import Trigger

from kalman_ros.codecs.messages import nanoseconds
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import Sample, WireReader
from kalman_ros.core import Array, Option, Sensor, Value
from kalman_ros.estimators import build_filter, filter_options
from kalman_ros.estimators.consistency import ChiSquareWindow, chi_square_gate
from kalman_ros.estimators.filter import Correction, Filter
from kalman_ros.estimators.online import OnlineEstimator, Outcome, Policy
from kalman_ros.simulation.observability import observability
from kalman_ros.simulation.scenario import Scenario

from . import runtime
from .diagnostics import Diagnostics, Level, Report
from .estimates import EstimatePublisher, InnovationPublisher
from .initial_pose import PoseReader
from .options import EstimatorOptions
from .readings import ReadingReader
from .topics import QUEUE, sensor_queue
from .turns import Turns


class EstimatorNode(runtime.ScenarioNode):
    """Feeds an `OnlineEstimator` from topics and publishes what it believes."""

    def __init__(self) -> None:
        super().__init__('estimator', EstimatorOptions)
        scenario, options = self.scenario, self.options
        filter, sensors, policy = self._design(scenario, options)
        zero = np.zeros(scenario.model.input.size)
        seen = observability(scenario)
        self._online = OnlineEstimator(filter, sensors, scenario.initial_belief, zero, policy)
        self._publish = EstimatePublisher(self, scenario, options.frame, options.child_frame)
        self._read_input = WireReader(SignalCodec(scenario.input))
        self._readers: dict[str, ReadingReader] = {}
        self._innovations: dict[str, InnovationPublisher] = {}
        self._nis: dict[str, ChiSquareWindow] = {}
        self._inputs: Counter[Outcome] = Counter()
        for name, source in scenario.sensors.items():
            output, signal = source.sensor.output, source.signal
            self._readers[name] = ReadingReader(signal)
            self._innovations[name] = InnovationPublisher(self, scenario.state.topic, name, output)
            self._nis[name] = ChiSquareWindow(output.size)
            queue = QUEUE if options.lockstep else sensor_queue(reliable=source.reliable)
            callback = partial(self._on_reading, name)
            kind = self._readers[name].message_type
            self.create_subscription(kind, signal.topic, callback, queue, raw=True)
        kind = self._read_input.message_type
        self.create_subscription(kind, scenario.input.topic, self._on_input, QUEUE, raw=True)
        self._turns: Optional[Turns] = None
        if options.lockstep:
            self._turns = Turns({source.signal.topic: n for n, source in scenario.sensors.items()})
            self.create_subscription(TimeReference, 'tick', self._on_tick, QUEUE)
        elif options.publish_rate:
            self.create_timer(1.0 / options.publish_rate, self._publish_now)
        self._read_pose = PoseReader(scenario)
        kind = self._read_pose.message_type
        self.create_subscription(kind, 'initialpose', self._on_initial_pose, QUEUE, raw=True)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.diagnostics = Diagnostics(self, self._report)
        self.get_logger().info(str(seen))

    def extra_options(self, given: Mapping[str, Value]) -> Iterable[Option]:
        """Return the options of the filter."""
        filter, implementation = given.get('filter', 'kf'), given.get('implementation', 'native')
        return filter_options(str(filter), str(implementation))

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _on_reading(self, name: str, data: bytes) -> None:
        source = self.scenario.sensors[name]
        if not source.timed.enabled:
            return
        reading = self._readers[name](data, source)
        time = reading.time or self._now()
        if self._turns is not None:
            self._turns.reading(name, time, reading)
            self._take_turns(self._turns)
        else:
            correction = self._fuse(name, time, reading, self._now() or None)
            if correction is not None:
                if self._online.time is not None and not self.options.publish_rate:
                    self._publish(self._online.time, self._online.belief)
                self._innovations[name](time, correction)

    def _fuse(
        self, name: str, time: int, reading: Sample, now: Optional[int] = None
    ) -> Optional[Correction]:
        outcome, correction = self._online.add_reading(
            name, time, reading.values, reading.covariance, now
        )
        if correction is not None:
            self._nis[name].add(correction.nis)
        if outcome is not Outcome.FUSED:
            self._warn(f'reading of {name} {outcome.value}')
        return correction

    def _on_input(self, data: bytes) -> None:
        try:
            input = self._read_input(data)
        except LookupError as error:
            self._warn(f'{self.scenario.input.topic}: {error}')
            return
        time = input.time or self._now()
        if self._turns is not None:
            self._turns.input(time, input.values)
            self._take_turns(self._turns)
        else:
            self._add_input(time, input.values)

    def _add_input(self, time: int, u: Array) -> None:
        outcome = self._online.add_input(time, u)
        self._inputs[outcome] += 1
        if outcome is not Outcome.FUSED:
            self._warn(f'{self.scenario.input.topic} {outcome.value}')

    def _on_tick(self, tick: TimeReference) -> None:
        if self._turns is None:
            return
        if self._turns.tick(nanoseconds(tick.header.stamp), tick.source):
            self.get_logger().info('time went back: starting anew')
            self._online.reset(self.scenario.initial_belief)
        self._take_turns(self._turns)

    def _take_turns(self, turns: Turns) -> None:
        for turn in turns.complete():
            if turn.input is not None:
                self._add_input(*turn.input)
            corrections = [(name, self._fuse(name, turn.time, y)) for name, y in turn.readings]
            self._publish(turn.time, self._online.predicted(turn.time))
            for name, correction in corrections:
                if correction is not None:
                    self._innovations[name](turn.time, correction)

    def _publish_now(self) -> None:
        now = self._now()
        if self._online.time is not None:
            time = max(now, self._online.time)
            self._publish(time, self._online.predicted(time))

    def _on_initial_pose(self, data: bytes) -> None:
        try:
            belief = self._read_pose(data, self.scenario.initial_belief)
        except ValueError as error:
            self._warn(f'initialpose: {error}')
            return
        self._online.reset(belief)
        self.get_logger().info('started anew from initialpose')

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._online.reset(self.scenario.initial_belief)
        response.success, response.message = True, 'back at the initial belief'
        return response

    def _warn(self, message: str) -> None:
        self.get_logger().warning(message, throttle_duration_sec=1.0)

    def prepare(self, scenario: Scenario, options: EstimatorOptions) -> Callable[[], None]:
        """Change the model's parameters, noise or gates; the belief stays."""
        filter, sensors, policy = self._design(scenario, options)
        return lambda: self._online.configure(filter, sensors, policy)

    def _design(
        self, scenario: Scenario, options: EstimatorOptions
    ) -> tuple[Filter, dict[str, Sensor], Policy]:
        """Return the filter, the sensors by name and the policy; ValueError if there is none."""
        filter = build_filter(options.filter, scenario.plan, self.extra, options.implementation)
        sensors = {name: source.sensor for name, source in scenario.sensors.items()}
        if options.initialize not in ('belief', 'reading'):
            raise ValueError(f"initialize: expected belief or reading, got '{options.initialize}'")
        gates = {}
        if options.gate < 1.0:
            gates = {n: chi_square_gate(options.gate, s.output.size) for n, s in sensors.items()}
        policy = Policy(
            options.window,
            gates,
            options.gate_recover_after,
            options.restart_after,
            options.max_gap,
            options.future_tolerance,
            options.initialize == 'reading',
        )
        return filter, sensors, policy

    def _report(self) -> Report:
        values: dict[str, Any] = {}
        doubtful = []
        for name, counts in self._online.counts.items():
            nis = self._nis[name]
            values[f'{name}: readings'] = sum(counts.values())
            for outcome, count in counts.items():
                values[f'{name}: {outcome.value}'] = count
            values[f'{name}: NIS / expected'] = nis.mean
            if not nis.inside():
                doubtful.append(name)
        values[f'{self.scenario.input.topic}: used'] = self._inputs[Outcome.FUSED]
        values['restarts'] = self._online.restarts
        values['repairs of the covariance'] = self._online.belief.repairs
        if self._online.time is None:
            return Level.WARN, 'no reading has come', values
        if doubtful:
            which = ' and '.join(doubtful)
            return Level.WARN, f'innovations of {which} do not scatter as expected', values
        return Level.OK, 'consistent', values


def main() -> None:
    """Run the estimator."""
    runtime.main(EstimatorNode)
