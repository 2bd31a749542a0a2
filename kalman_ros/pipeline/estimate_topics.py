# SPDX-License-Identifier: Apache-2.0
"""Topics on which an estimator publishes its beliefs and innovations, and their messages."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.codecs.messages import message_type
from kalman_ros.codecs.signal_codec import SignalCodec, named
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Signal, Space
from kalman_ros.estimators.filter import Correction
from kalman_ros.scenario import Scenario


def state_signal(state: Signal, space: Space) -> Signal:
    """Return the signal of the state of an estimate, by the names of its coordinates."""
    return named(Signal(f'{state.topic}/state', '', ()), space.names)


def covariance_signal(state: Signal) -> Signal:
    """Return the signal of the whole covariance (n, n) of an estimate, row by row."""
    fields = tuple(f'data[{index}]' for index in range(len(state.fields) ** 2))
    return Signal(f'{state.topic}/covariance', 'std_msgs/Float64MultiArray', fields)


def smoothed_signal(state: Signal) -> Signal:
    """Return the signal of the smoothed estimate, which has the type of the estimate."""
    return replace(state, topic=f'{state.topic}/smoothed')


def innovation_signal(state: Signal, sensor: str, output: Space) -> Signal:
    """Return the signal of a sensor's innovations, their deviations, and their NIS."""
    names = (*output.names, *(f'{name}_std' for name in output.names), 'nis')
    return named(Signal(f'{state.topic}/innovation/{sensor}', '', ()), names)


def published_signals(scenario: Scenario) -> list[Signal]:
    """Return the signals that the estimator of a scenario publishes."""
    state = scenario.state
    return [
        state,
        state_signal(state, scenario.model.state),
        covariance_signal(state),
        *(
            innovation_signal(state, name, source.sensor.output)
            for name, source in scenario.enabled.items()
        ),
    ]


class Topic(NamedTuple):
    """A topic, and the writer of its messages."""

    signal: Signal
    write: WireWriter

    @property
    def name(self) -> str:
        """Name of the topic."""
        return self.signal.topic


class EstimateTopics:
    """The topics of a belief: ``estimate``, ``estimate/state`` and ``estimate/covariance``.

    Each is written with the time and, in this order: the mean (n,) and covariance (n, n); the
    mean; the covariance, flat.
    """

    def __init__(self, scenario: Scenario, frame: str, child_frame: str) -> None:
        space, signal = scenario.model.state, scenario.state
        self.estimate = Topic(signal, WireWriter(SignalCodec(signal, frame, child_frame)))
        state = state_signal(signal, space)
        self.state = Topic(state, WireWriter(SignalCodec(state, frame)))
        whole = covariance_signal(signal)
        self.covariance = Topic(whole, WireWriter(_labelled(SignalCodec(whole), space)))


def _labelled(codec: SignalCodec, space: Space) -> SignalCodec:
    """Return the codec of a matrix (n, n), row by row, with its dimensions labelled."""
    n, names = space.size, ','.join(space.names)
    dimension = message_type('std_msgs/MultiArrayDimension')
    codec.message.layout.dim = [
        dimension(label=names, size=n, stride=stride) for stride in (n * n, n)
    ]
    return codec


class InnovationTopic:
    """A sensor's innovations as named values on ``estimate/innovation/SENSOR``.

    Each innovation comes with its expected standard deviation, ``NAME_std``, and the
    normalised innovation squared of the reading, ``nis``.
    """

    def __init__(self, state: Signal, sensor: str, output: Space) -> None:
        signal = innovation_signal(state, sensor, output)
        self.topic = Topic(signal, WireWriter(SignalCodec(signal)))

    def __call__(self, time: int, correction: Correction) -> Any:
        """Return the message for a reading taken at ``time``; None if a number is not finite."""
        std = np.sqrt(correction.innovation_covariance.diagonal())
        values = np.concatenate((correction.innovation, std, (correction.nis,)))
        return self.topic.write(time, values) if np.isfinite(values).all() else None
