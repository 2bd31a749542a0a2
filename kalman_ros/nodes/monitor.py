# SPDX-License-Identifier: Apache-2.0
"""The monitor: the consistency of the estimate, and the cost of the control."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Gaussian, Signal, Value
from kalman_ros.estimators.consistency import ChiSquareWindow
from kalman_ros.estimators.error_statistics import Comparison
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import price

from . import runtime
from .diagnostics import Level, Report
from .options import MonitorOptions
from .pairing import Pairing
from .throttle import Throttle
from .topics import WATCH, covariance_signal, innovation_signal, on_topic

#: Seconds between two looks at what has come.
_PERIOD = 0.02


class MonitorNode(runtime.ScenarioNode):
    """Listens to everything, says on ``/diagnostics`` how well it goes, and changes nothing."""

    with_law = True

    def __init__(self) -> None:
        super().__init__('monitor', MonitorOptions)

    def activate(self) -> None:
        """Begin to compare, and listen."""
        scenario = self.scenario
        self._warn = Throttle(self.get_logger().warning)
        self._compare_anew(*self._fresh(scenario, self.options))
        expect = self.diagnostics.connections.expect
        expect(self._watch(on_topic(scenario.state, 'ground_truth'), self._on_truth))
        expect(self._watch(scenario.state, self._on_estimate))
        if scenario.input.fields:
            self._watch(scenario.input, self._on_input)
        self._whole = self._watch(covariance_signal(scenario.state), self._on_covariance)
        for name, source in scenario.sensors.items():
            self._watch(source.signal, partial(self._on_reading, name))
            innovation = innovation_signal(scenario.state, name, source.sensor.output)
            self._watch(innovation, partial(self._on_innovation, name))
        self.look_every(_PERIOD)

    @staticmethod
    def _fresh(
        scenario: Scenario, options: MonitorOptions
    ) -> tuple[Comparison, dict[str, ChiSquareWindow]]:
        sensors = {name: source.sensor for name, source in scenario.sensors.items()}
        length = options.monitor_window
        comparison = Comparison(scenario.model.state, sensors, price(scenario).weight, length)
        nis = {
            name: ChiSquareWindow(sensor.output.size, length) for name, sensor in sensors.items()
        }
        return comparison, nis

    def _compare_anew(self, comparison: Comparison, nis: dict[str, ChiSquareWindow]) -> None:
        self._comparison, self._nis, self._pairing = comparison, nis, Pairing()

    def _watch(self, signal: Signal, take: Callable[[Sample], None]) -> Any:
        """Subscribe to a signal; messages that cannot be read are passed over."""
        read = WireReader(SignalCodec(signal))

        def on_message(data: bytes) -> None:
            try:
                take(read(data))
            except (LookupError, ValueError):
                self._warn(f'{signal.topic}: a message cannot be read')

        kind, topic = read.message_type, signal.topic
        return self.watch(kind, topic, on_message, WATCH)

    def _on_truth(self, sample: Sample) -> None:
        self._comparison.truth(sample.time or 0, sample.values)

    def _on_input(self, sample: Sample) -> None:
        if sample.time is not None:
            self._comparison.input(sample.time, sample.values)

    def _on_reading(self, name: str, sample: Sample) -> None:
        if sample.time is not None and np.isfinite(sample.values).all():
            self._comparison.reading(name, sample.time, sample.values)

    def _on_innovation(self, name: str, sample: Sample) -> None:
        self._nis[name].add(float(sample.values[-1]))

    def _on_estimate(self, sample: Sample) -> None:
        """Take the estimate at once, or when its whole covariance has come, if one will."""
        n, P = sample.values.size, sample.covariance
        time, x = sample.time or 0, sample.values
        if self._whole.get_publisher_count():
            own = np.zeros((n, n)) if P is None else P
            self._compare(self._pairing.estimate(time, Gaussian(x, own)))
            return
        self._compare((time, Gaussian(x, np.full((n, n), np.nan) if P is None else P)))

    def _on_covariance(self, sample: Sample) -> None:
        n = self.scenario.model.state.size
        self._compare(self._pairing.covariance(sample.values.reshape(n, n)))

    def _compare(self, pair: tuple[int, Gaussian] | None) -> None:
        if pair is not None:
            self._comparison.estimate(*pair)

    def prepare(
        self, scenario: Scenario, options: MonitorOptions, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Restart the comparison with the changed model, noise or cost."""
        return partial(self._compare_anew, *self._fresh(scenario, options))

    def report(self) -> Report:
        """Return errors, consistency and cost, and what is outside its bounds."""
        comparison, space = self._comparison, self.scenario.model.state
        miss = 1.0 - self.options.confidence
        values: dict[str, Any] = {'estimates compared': comparison.error.count}
        for name, error in zip(space.names, comparison.error.root):
            values[f'RMSE of {space.label(name)}'] = float(error)
        for name, source in self.scenario.sensors.items():
            labels = map(source.sensor.output.label, source.sensor.output.names)
            raw, fused = comparison.raw[name].root, comparison.fused[name].root
            for label, before, after in zip(labels, raw, fused):
                values[f'{name} {label}: error raw / estimated'] = f'{before:.4g} / {after:.4g}'
        verdicts: dict[str, ChiSquareWindow] = {'NEES': comparison.nees}
        verdicts.update({f'NIS of {name}': nis for name, nis in self._nis.items()})
        doubtful = []
        for name, window in verdicts.items():
            low, high = window.bounds(miss)
            values[f'{name} / expected'] = f'{window.mean:.3f} ({low:.3f} to {high:.3f})'
            if not window.inside(miss):
                doubtful.append(name)
        if comparison.steps:
            per_second = comparison.cost / comparison.steps * self.scenario.rate
            values['cost J'] = comparison.cost
            values['cost per second'] = per_second
        if doubtful:
            why = ''
            if 'NEES' in doubtful:
                too_sure = comparison.nees.mean > 1.0
                why = f': the estimator is {"over" if too_sure else "under"}confident'
            return Level.WARN, f'{" and ".join(doubtful)} outside the bounds{why}', values
        if not comparison.error.count:
            return Level.WARN, 'no truth and estimate with the same stamp received', values
        return Level.OK, 'consistent', values


def main() -> None:
    """Run the monitor."""
    runtime.main(MonitorNode)
