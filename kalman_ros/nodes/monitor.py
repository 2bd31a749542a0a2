# SPDX-License-Identifier: Apache-2.0
"""The monitor: whether the estimate is as good as it says, and what the control costs."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from kalman_ros.codecs.messages import stamp_of
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.control.lqr import Cost, cost, sampled_cost
from kalman_ros.core import Array, Gaussian, linearize
from kalman_ros.estimators.comparison import Comparison
from kalman_ros.estimators.consistency import ChiSquareWindow
from kalman_ros.simulation.scenario import Scenario

from . import runtime
from .diagnostics import Diagnostics, Level, Report
from .options import MonitorOptions
from .topics import WATCH

#: So many covariances are kept for the estimate that they belong to.
_KEPT = 50


def sample_cost(scenario: Scenario) -> Cost:
    """Return the cost of one sample of a scenario."""
    model = scenario.model
    n, m = model.state.size, model.input.size
    system = linearize(model, np.zeros(n), np.zeros(m))
    weights = cost(scenario.state_cost, scenario.input_cost, (n, m))
    return sampled_cost(system, weights, 1.0 / scenario.rate)


class MonitorNode(runtime.ScenarioNode):
    """Listens to everything, says on ``/diagnostics`` how well it goes, and changes nothing."""

    def __init__(self) -> None:
        super().__init__('monitor', MonitorOptions)
        self._comparison = self._fresh_comparison(self.scenario, self.options)
        scenario = self.scenario
        self._state, self._input = SignalCodec(scenario.state), SignalCodec(scenario.input)
        kind, topic = self._state.message_type, scenario.state.topic
        self.create_subscription(kind, 'ground_truth', self._on_truth, WATCH)
        self.create_subscription(kind, topic, self._on_estimate, WATCH)
        kind, force = self._input.message_type, scenario.input.topic
        self.create_subscription(kind, force, self._on_input, WATCH)
        self._whole = self.create_subscription(
            Float64MultiArray, f'{topic}/covariance', self._on_covariance, WATCH
        )
        self._beliefs: deque[tuple[int, Gaussian]] = deque(maxlen=_KEPT)
        self._covariances: deque[Array] = deque(maxlen=_KEPT)
        self._readings: dict[str, SignalCodec] = {}
        self._nis: dict[str, ChiSquareWindow] = {}
        for name, source in scenario.sensors.items():
            codec = self._readings[name] = SignalCodec(source.signal)
            self._nis[name] = ChiSquareWindow(codec.size, self.options.monitor_window)
            on_reading = partial(self._on_reading, name)
            self.create_subscription(codec.message_type, source.signal.topic, on_reading, WATCH)
            on_innovation = partial(self._on_innovation, name)
            innovation = f'{topic}/innovation/{name}'
            self.create_subscription(JointState, innovation, on_innovation, WATCH)
        self.diagnostics = Diagnostics(self, self._report)

    def _fresh_comparison(self, scenario: Scenario, options: MonitorOptions) -> Comparison:
        sensors = {name: source.sensor for name, source in scenario.sensors.items()}
        weight = sample_cost(scenario).weight
        return Comparison(scenario.model.state, sensors, weight, options.monitor_window)

    def _on_truth(self, message: Any) -> None:
        self._comparison.truth(stamp_of(message) or 0, self._state.decode(message))

    def _on_input(self, message: Any) -> None:
        time = stamp_of(message)
        if time is not None:
            self._comparison.input(time, self._input.decode(message))

    def _on_reading(self, name: str, message: Any) -> None:
        y = self._readings[name].decode(message)
        time = stamp_of(message)
        if time is not None and np.isfinite(y).all():
            self._comparison.reading(name, time, y)

    def _on_innovation(self, name: str, message: JointState) -> None:
        self._nis[name].add(message.position[-1])

    def _on_estimate(self, message: Any) -> None:
        """Take the estimate at once, or when its whole covariance has come, if one will."""
        P = self._state.decode_covariance(message)
        n = self._state.size
        belief = Gaussian(self._state.decode(message), np.zeros((n, n)) if P is None else P)
        time = stamp_of(message) or 0
        if self._whole.get_publisher_count():
            self._beliefs.append((time, belief))
            self._pair()
        else:
            self._comparison.estimate(time, belief)

    def _on_covariance(self, message: Float64MultiArray) -> None:
        n = self._state.size
        if len(message.data) == n * n:
            self._covariances.append(np.array(message.data).reshape(n, n))
            self._pair()

    def _pair(self) -> None:
        """Give each estimate its whole covariance: the first that agrees with its own part."""
        while self._beliefs and self._covariances:
            time, belief = self._beliefs[0]
            own, whole = belief.covariance, self._covariances[0]
            if not np.array_equal(own[own != 0.0], whole[own != 0.0]):
                self._covariances.popleft()
                continue
            self._comparison.estimate(time, Gaussian(belief.mean, whole))
            self._beliefs.popleft()
            self._covariances.popleft()

    def prepare(self, scenario: Scenario, options: MonitorOptions) -> Callable[[], None]:
        """Start to compare anew, with the changed model, noise or costs."""
        comparison = self._fresh_comparison(scenario, options)

        def apply() -> None:
            self._comparison = comparison

        return apply

    def _report(self) -> Report:
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
        verdicts = {'NEES': comparison.nees}
        verdicts.update({f'NIS of {name}': nis for name, nis in self._nis.items()})
        doubtful = []
        for name, window in verdicts.items():
            low, high = window.bounds(miss)
            values[f'{name} / expected'] = f'{window.mean:.3f} ({low:.3f} to {high:.3f})'
            if name != 'NEES' and not window.inside(miss):
                doubtful.append(name)
        if comparison.steps:
            per_second = comparison.cost / comparison.steps * self.scenario.rate
            values['cost J'] = comparison.cost
            values['cost per second'] = per_second
        if not comparison.error.count:
            return Level.WARN, 'no truth and estimate of one instant have come', values
        if doubtful:
            return Level.WARN, f'{" and ".join(doubtful)} outside the bounds', values
        return Level.OK, 'consistent', values


def main() -> None:
    """Run the monitor."""
    runtime.main(MonitorNode)
