# SPDX-License-Identifier: Apache-2.0
"""The markers: a loop in the plane or in space, drawn for RViz and other viewers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Signal, Value
from kalman_ros.nodes.middleware import runtime
from kalman_ros.nodes.middleware.diagnostics import Level, Report
from kalman_ros.nodes.middleware.topics import on_topic, watched
from kalman_ros.pipeline.estimate_topics import covariance_signal
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.scenario import Scenario

from .drawing import MarkerDrawing
from .options import MarkersOptions

#: Seconds between two looks whether somebody looks.
_LOOK = 0.5


class MarkersNode(runtime.ScenarioNode):
    """Publishes ``markers`` while it has subscribers, and subscribes to the loop only then."""

    def __init__(self) -> None:
        super().__init__('markers', MarkersOptions)

    def configure(self) -> None:
        """Check that the scenario can be drawn, and create the publisher."""
        super().configure()
        self._warn = Throttle(self.get_logger().warning)
        self._drawing = self._fresh(self.scenario, self.options)
        self._publisher = self.create_publisher(self._drawing.message_type, 'markers', 1)

    def activate(self) -> None:
        """Wait for a subscriber."""
        self._subscriptions_to_loop: list[Any] = []
        self.at_the_end(self._unsubscribe)
        self.create_timer(_LOOK, self._follow, clock=self.steady)
        self.create_timer(1.0 / self.options.marker_rate, self._draw, clock=self.steady)

    @staticmethod
    def _fresh(scenario: Scenario, options: MarkersOptions) -> MarkerDrawing:
        return MarkerDrawing(scenario, options.frame, options.track_length)

    def _follow(self) -> None:
        """Subscribe to the loop if somebody looks at it, and only then."""
        seen = self._publisher.get_subscription_count() > 0
        if seen and not self._subscriptions_to_loop:
            self._subscribe()
        elif not seen:
            self._unsubscribe()

    def _subscribe(self) -> None:
        scenario = self.scenario
        state = scenario.state
        self._drawing = self._fresh(scenario, self.options)
        self._watch(on_topic(state, 'ground_truth'), lambda s: self._drawing.truth(s.values))
        self._watch(state, lambda s: self._drawing.estimate(s.time or 0, s.values))
        self._watch(covariance_signal(state), self._on_covariance)
        for name, source in scenario.enabled.items():
            self._watch(source.signal, partial(self._on_reading, name))

    def _unsubscribe(self) -> None:
        while self._subscriptions_to_loop:
            self.destroy_subscription(self._subscriptions_to_loop.pop())

    def _watch(self, signal: Signal, take: Callable[[Sample], None]) -> None:
        """Subscribe to a signal."""
        self._subscriptions_to_loop.append(watched(self, signal, take, self._warn))

    def _on_covariance(self, sample: Sample) -> None:
        n = self.scenario.model.state.size
        self._drawing.covariance(sample.values.reshape(n, n))

    def _on_reading(self, name: str, sample: Sample) -> None:
        self._drawing.reading(name, sample.values)

    def _draw(self) -> None:
        self.look()
        markers = self._drawing.draw() if self._subscriptions_to_loop else None
        if markers is not None:
            self._publisher.publish(markers)

    def prepare(
        self, scenario: Scenario, options: MarkersOptions, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Start new tracks with the changed model or sensors."""
        drawing = self._fresh(scenario, options)

        def put_in_place() -> None:
            self._drawing = drawing

        return put_in_place

    def report(self) -> Report:
        """Return whether markers are drawn."""
        drawn = bool(self._subscriptions_to_loop)
        return Level.OK, 'drawing' if drawn else 'no subscriber', {}


def main() -> None:
    """Run the node."""
    runtime.main(MarkersNode)
