# SPDX-License-Identifier: Apache-2.0
"""The monitor: the consistency of the estimate, and the cost of the control."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import isfinite
from time import monotonic
from typing import Any

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.messages import has_header
from kalman_ros.core import Gaussian, Signal, Value
from kalman_ros.estimators.consistency import ChiSquareWindow, verdict
from kalman_ros.estimators.error_statistics import Comparison
from kalman_ros.nodes.middleware import runtime
from kalman_ros.nodes.middleware.connections import PATIENCE
from kalman_ros.nodes.middleware.diagnostics import Level, Report
from kalman_ros.nodes.middleware.topics import on_topic, watched
from kalman_ros.pipeline.estimate_topics import covariance_signal, innovation_signal
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import price

from .options import MonitorOptions
from .pairing import Pairing

#: Seconds between two checks for new messages.
_PERIOD = 0.02
#: The share of the last estimates that may be missing from a verdict, and the fewest to judge.
_MOST_MISSING, _FEWEST = 0.05, 10


class MonitorNode(runtime.ScenarioNode):
    """Subscribes to everything, reports on ``/diagnostics``, and changes nothing."""

    with_law = True

    def __init__(self) -> None:
        super().__init__('monitor', MonitorOptions)

    def activate(self) -> None:
        """Start the comparison and subscribe."""
        scenario = self.scenario
        self._warn = Throttle(self.get_logger().warning)
        self._replace_comparison(*self._fresh(scenario, self.options))
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

    def _replace_comparison(self, comparison: Comparison, nis: dict[str, ChiSquareWindow]) -> None:
        self._comparison, self._nis, self._pairing = comparison, nis, Pairing()
        #: How many estimates had been compared at the last report that found new ones, and when.
        self._count, self._compared_at = 0, monotonic()

    def _watch(self, signal: Signal, take: Callable[[Sample], None]) -> Any:
        """Subscribe to a signal."""
        return watched(self, signal, take, self._warn)

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
        """Compare the estimate at once, or with its whole covariance, if that is published."""
        n, P = sample.values.size, sample.covariance
        time, x = sample.time or 0, sample.values
        if self._whole.get_publisher_count():
            covariance = np.zeros((n, n)) if P is None else P
            self._compare(self._pairing.estimate(time, Gaussian(x, covariance)))
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
        return partial(self._replace_comparison, *self._fresh(scenario, options))

    def report(self) -> Report:
        """Return errors, consistency and cost, and which of them are outside their bounds."""
        comparison, space = self._comparison, self.scenario.model.state
        comparison.settle()
        miss = 1.0 - self.options.confidence
        values: dict[str, Any] = {'estimates compared': comparison.error.count}
        for name, error in zip(space.names, comparison.error.root):
            values[f'RMSE of {space.label(name)}'] = float(error)
        for name, source in self.scenario.sensors.items():
            labels = map(source.sensor.output.label, source.sensor.output.names)
            raw, fused = comparison.raw[name].root, comparison.fused[name].root
            for label, before, after in zip(labels, raw, fused):
                if isfinite(before) and isfinite(after):
                    key = f'{name} {label}: error raw / estimated'
                    values[key] = f'{before:.4g} / {after:.4g}'
        verdicts: dict[str, ChiSquareWindow] = {'NEES': comparison.nees}
        verdicts.update({f'NIS of {name}': nis for name, nis in self._nis.items()})
        doubtful = []
        for name, window in verdicts.items():
            low, high = window.bounds(miss)
            if window.count:
                values[f'{name} / expected'] = f'{window.mean:.3f} ({low:.3f} to {high:.3f})'
            if not window.inside(miss):
                doubtful.append(name)
        if comparison.steps:
            per_second = comparison.cost / comparison.steps * self.scenario.rate
            values['cost J'] = comparison.cost
            values['cost per second'] = per_second
        if doubtful:
            why = ''
            if 'NEES' in doubtful and not np.isnan(comparison.nees.mean):
                too_sure = comparison.nees.mean > 1.0
                why = f': the estimator is {"over" if too_sure else "under"}confident'
            return Level.WARN, f'{" and ".join(doubtful)} outside the bounds{why}', values
        incomplete = self._incomplete()
        if incomplete:
            return Level.WARN, incomplete, values
        unused = {
            f'NIS of {name}'
            for name, source in self.scenario.sensors.items()
            if name not in self.scenario.enabled or not source.judged
        }
        judged = {name: window for name, window in verdicts.items() if name not in unused}
        return Level.OK, verdict(judged), values

    def _unstamped(self) -> str:
        """Return why estimates may have other stamps than the truth."""
        sensors = self.scenario.sensors
        names = [
            name for name in self.scenario.enabled if not has_header(sensors[name].signal.type)
        ]
        if not names:
            return ''
        return f': readings of {", ".join(names)} have no stamp, and count from their receipt'

    def _incomplete(self) -> str:
        """Return why what was compared is not enough for a verdict; '' if it is."""
        comparison, now = self._comparison, monotonic()
        count, compared = comparison.error.count, comparison.compared
        if count != self._count:
            self._count, self._compared_at = count, now
        if not count:
            return f'no truth and estimate with the same stamp received{self._unstamped()}'
        missing = len(compared) - sum(compared)
        if missing > _MOST_MISSING * len(compared):
            why = 'they are not finite, or no truth with their stamp was received'
            return f'{missing} of the last {len(compared)} estimates cannot be compared: {why}'
        if now - self._compared_at > PATIENCE:
            return f'nothing to compare received for {now - self._compared_at:.0f} s'
        few = f'{count} estimates compared, at least {_FEWEST} needed'
        return few if count < _FEWEST else ''


def main() -> None:
    """Run the monitor."""
    runtime.main(MonitorNode)
