# SPDX-License-Identifier: Apache-2.0
"""What an estimator publishes: first what a controller waits for, the rest to those who listen."""

from __future__ import annotations

from typing import Any

import numpy as np
from std_msgs.msg import MultiArrayDimension

from kalman_ros.codecs.signal_codec import SignalCodec, named
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Gaussian, Signal, Space
from kalman_ros.estimators.correction import Correction
from kalman_ros.scenario import Scenario

from .topics import HISTORY, covariance_signal


class EstimatePublisher:
    """Publishes a belief on ``estimate``, ``estimate/state`` and ``estimate/covariance``."""

    def __init__(self, node: Any, scenario: Scenario, frame: str, child_frame: str) -> None:
        space, signal = scenario.model.state, scenario.state
        self._estimate = WireWriter(SignalCodec(signal, frame, child_frame))
        state = Signal(f'{signal.topic}/state', '', ())
        self._state = WireWriter(SignalCodec(named(state, space.names), frame))
        whole = covariance_signal(signal)
        self._covariance = WireWriter(_labelled(SignalCodec(whole), space))
        create = node.create_publisher
        self._publisher = create(self._estimate.message_type, signal.topic, HISTORY)
        self._state_publisher = create(self._state.message_type, state.topic, HISTORY)
        self._covariance_publisher = create(self._covariance.message_type, whole.topic, HISTORY)
        #: How many beliefs have been published.
        self.count = 0

    def __call__(self, time: int, belief: Gaussian) -> None:
        """Publish a ``belief`` that holds at ``time``, in nanoseconds."""
        self.count += 1
        x, P = belief.mean, belief.covariance
        self._publisher.publish(self._estimate(time, x, P))
        if self._state_publisher.get_subscription_count():
            self._state_publisher.publish(self._state(time, x))
        if self._covariance_publisher.get_subscription_count():
            self._covariance_publisher.publish(self._covariance(time, P.ravel()))


def _labelled(codec: SignalCodec, space: Space) -> SignalCodec:
    """Return the codec of a matrix (n, n), row by row, with its dimensions labelled."""
    n, names = space.size, ','.join(space.names)
    codec.message.layout.dim = [
        MultiArrayDimension(label=names, size=n, stride=stride) for stride in (n * n, n)
    ]
    return codec


class InnovationPublisher:
    """Publishes a sensor's innovations as named values on ``estimate/innovation/SENSOR``.

    Beside each innovation stand its expected standard deviation, ``NAME_std``, and the
    normalised innovation squared of the reading, ``nis``.
    """

    def __init__(self, node: Any, signal: Signal) -> None:
        self._write = WireWriter(SignalCodec(signal))
        self._publisher = node.create_publisher(self._write.message_type, signal.topic, HISTORY)

    def __call__(self, time: int, correction: Correction) -> None:
        """Publish what the reading taken at ``time`` said."""
        if self._publisher.get_subscription_count():
            std = np.sqrt(correction.innovation_covariance.diagonal())
            values = np.concatenate((correction.innovation, std, (correction.nis,)))
            if np.isfinite(values).all():
                self._publisher.publish(self._write(time, values))
