# SPDX-License-Identifier: Apache-2.0
"""The controller: an estimate in, the force that answers it out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from std_srvs.srv import SetBool

from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array
from kalman_ros.simulation.regulator import regulator
from kalman_ros.simulation.scenario import Scenario

from . import runtime
from .diagnostics import Diagnostics, Level, Report
from .options import ControllerOptions
from .topics import QUEUE


class ControllerNode(runtime.ScenarioNode):
    """Answers every estimate with the force u = -K x."""

    def __init__(self) -> None:
        super().__init__('controller', ControllerOptions)
        scenario, options = self.scenario, self.options
        self._design, _ = regulator(scenario)
        self._enabled = options.enabled
        self._answered = self._refused = 0
        self._zero: Array = np.zeros(scenario.model.input.size)
        self._unknown = np.full(scenario.model.state.size, np.nan)
        self._read_state = WireReader(SignalCodec(scenario.state))
        self._input = SignalCodec(scenario.input, options.frame)
        kind = self._input.message_type
        self._publisher = self.create_publisher(kind, scenario.input.topic, QUEUE)
        kind = self._read_state.message_type
        self.create_subscription(kind, scenario.state.topic, self._on_estimate, QUEUE, raw=True)
        self.create_service(SetBool, '~/enable', self._on_enable)
        self.diagnostics = Diagnostics(self, self._report)

    def _on_estimate(self, data: bytes) -> None:
        try:
            time, x, _ = self._read_state(data)
        except LookupError:
            time, x = None, self._unknown
        if time is None:
            time = self.get_clock().now().nanoseconds
        force = self._zero
        if self._enabled:
            force = -(self._design.gain @ x)
            if not np.isfinite(force).all():
                force = self._zero
                self._refused += 1
                self.get_logger().error(
                    'the estimate is not finite: the force is zero', throttle_duration_sec=1.0
                )
        self._publisher.publish(self._input.encode(time, force))
        self._answered += 1

    def _on_enable(self, request: Any, response: Any) -> Any:
        self._enabled = request.data
        response.success = True
        response.message = 'forces are computed' if self._enabled else 'forces are zero'
        return response

    def prepare(self, scenario: Scenario, options: ControllerOptions) -> Callable[[], None]:
        """Design the gain again, for other weights or another model."""
        found, _ = regulator(scenario)

        def apply() -> None:
            self._design = found

        return apply

    def _report(self) -> Report:
        values = {
            'estimates answered': self._answered,
            'estimates not finite': self._refused,
            'gain': np.array2string(self._design.gain, precision=4),
            'poles': np.array2string(self._design.poles, precision=4),
        }
        if not self._enabled:
            return Level.WARN, 'disabled: the force is zero', values
        if not self._answered:
            return Level.WARN, f'no {self.scenario.state.topic} has come', values
        return Level.OK, 'running', values


def main() -> None:
    """Run the controller."""
    runtime.main(ControllerNode)
