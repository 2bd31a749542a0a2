# SPDX-License-Identifier: Apache-2.0
"""What an estimator publishes: first what a controller waits for, the rest to those who listen."""

from __future__ import annotations

from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from kalman_ros.codecs.signal_codec import SignalCodec, named
from kalman_ros.core import Gaussian, Signal, Space
from kalman_ros.estimators.filter import Correction
from kalman_ros.simulation.scenario import Scenario

from .topics import QUEUE


class EstimatePublisher:
    """Publishes a belief on ``estimate``, ``estimate/state`` and ``estimate/covariance``."""

    def __init__(self, node: Any, scenario: Scenario, frame: str, child_frame: str) -> None:
        space, signal = scenario.model.state, scenario.state
        self._estimate = SignalCodec(signal, frame, child_frame)
        state = Signal(f'{signal.topic}/state', '', ())
        self._state = SignalCodec(named(state, space.names), frame)
        self._covariance = Float64MultiArray(data=[0.0] * space.size**2)
        names = ','.join(space.names)
        self._covariance.layout.dim = [
            MultiArrayDimension(label=names, size=space.size, stride=space.size**2),
            MultiArrayDimension(label=names, size=space.size, stride=space.size),
        ]
        self._flat = np.frombuffer(self._covariance.data)
        create = node.create_publisher
        self._publisher = create(self._estimate.message_type, signal.topic, QUEUE)
        self._state_publisher = create(self._state.message_type, state.topic, QUEUE)
        topic = f'{signal.topic}/covariance'
        self._covariance_publisher = create(Float64MultiArray, topic, QUEUE)

    def __call__(self, time: int, belief: Gaussian) -> None:
        """Publish a ``belief`` that holds at ``time``, in nanoseconds."""
        x, P = belief.mean, belief.covariance
        self._publisher.publish(self._estimate.encode(time, x, P))
        if self._state_publisher.get_subscription_count():
            self._state_publisher.publish(self._state.encode(time, x))
        if self._covariance_publisher.get_subscription_count():
            self._flat[:] = P.ravel()
            self._covariance_publisher.publish(self._covariance)


class InnovationPublisher:
    """Publishes a sensor's innovations as named values on ``estimate/innovation/SENSOR``.

    Beside each innovation stand its expected standard deviation, ``NAME_std``, and the
    normalised innovation squared of the reading, ``nis``.
    """

    def __init__(self, node: Any, estimate: str, sensor: str, output: Space) -> None:
        names = (*output.names, *(f'{name}_std' for name in output.names), 'nis')
        signal = named(Signal(f'{estimate}/innovation/{sensor}', '', ()), names)
        self._codec = SignalCodec(signal)
        self._publisher = node.create_publisher(self._codec.message_type, signal.topic, QUEUE)

    def __call__(self, time: int, correction: Correction) -> None:
        """Publish what the reading taken at ``time`` said."""
        if self._publisher.get_subscription_count():
            std = np.sqrt(correction.innovation_covariance.diagonal())
            values = np.concatenate((correction.innovation, std, (correction.nis,)))
            self._publisher.publish(self._codec.encode(time, values))
