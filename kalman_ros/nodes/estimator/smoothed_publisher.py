# SPDX-License-Identifier: Apache-2.0
"""The smoothed estimate of an estimator, a fixed lag after the estimate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Gaussian, is_finite
from kalman_ros.estimators.filter import SmoothableFilter
from kalman_ros.estimators.fixed_lag import FixedLagSmoother
from kalman_ros.estimators.instants import Instants
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.smoother import unsmoothable
from kalman_ros.estimators.timeline import Item
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.topics import HISTORY
from kalman_ros.pipeline.estimate_topics import smoothed_signal
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.scenario import Scenario


class SmoothedPublisher:
    """Publishes on ``estimate/smoothed`` what no late reading can change any more.

    Raises
    ------
    ValueError
        If the filter cannot be smoothed.
    """

    def __init__(
        self, node: Host, scenario: Scenario, options: EstimatorOptions, online: OnlineEstimator
    ) -> None:
        if not isinstance(online.filter, SmoothableFilter):
            raise ValueError(f'fixed_lag: {unsmoothable()}')
        self._smoother = FixedLagSmoother(online.filter.model.state, options.fixed_lag)
        self._instants, self._believed = Instants(), scenario.believed
        signal = smoothed_signal(scenario.state)
        self._write = WireWriter(SignalCodec(signal, options.frame, options.child_frame))
        self._publisher = node.create_publisher(self._write.message_type, signal.topic, HISTORY)
        online.on_final, online.on_reset = self._take, self._clear

    def _take(self, items: Sequence[Item]) -> None:
        for step, filter in self._instants.take(items):
            self._publish(self._smoother.add(step, filter))

    def _clear(self) -> None:
        """Forget the states that will not get the readings of their lag."""
        self._instants = Instants()
        self._smoother.clear()

    def _publish(self, beliefs: Iterable[tuple[int, Gaussian]]) -> None:
        for time, belief in beliefs:
            mean, covariance = self._believed.own(belief) if self._believed.places else belief
            if is_finite(mean) and is_finite(covariance):
                self._publisher.publish(self._write(time, mean, covariance))
