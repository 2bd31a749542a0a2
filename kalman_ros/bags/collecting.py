# SPDX-License-Identifier: Apache-2.0
"""Collection of the results of a replay: in memory as arrays, and on disk as a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, nan
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

from kalman_ros.analysis.records import Beliefs, InputRecord
from kalman_ros.codecs.messages import full_type
from kalman_ros.codecs.padding import without_padding
from kalman_ros.core import Array, Gaussian
from kalman_ros.core.geodesy import Origin
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.pipeline.estimate_topics import EstimateTopics, InnovationTopic, Topic
from kalman_ros.pipeline.global_topics import GlobalTopics
from kalman_ros.pipeline.odometry_topic import OdometryTopic
from kalman_ros.pipeline.reading import Reading, Readings
from kalman_ros.pipeline.settings import Settings
from kalman_ros.scenario import SensorSource

from .columns import Rows
from .recording_writer import RecordingWriter
from .replayed import SensorReplay

_OUTCOMES = tuple(Outcome)
_CODES = {outcome: float(code) for code, outcome in enumerate(_OUTCOMES)}
#: Number of waiting messages above which all are handed to the system.
_FLUSH = 2000


def seconds(time: int, start: int) -> float:
    """Return ``time`` in seconds from ``start``; both are in nanoseconds."""
    return (time - start) * 1e-9


class SensorColumns:
    """The readings of one sensor, with their outcomes."""

    def __init__(self, source: SensorSource) -> None:
        k = source.sensor.output.size
        self._rows = Rows(
            numbers=(6,), value=(k,), covariance=(k, k), innovation=(k,), expected=(k, k)
        )
        self._configured: Array = source.sensor.covariance

    def add(self, reading: Reading, received: float, stamp: float) -> None:
        """Add a reading that was fused, or not."""
        assert reading.outcome is not None
        covariance = self._configured if reading.covariance is None else reading.covariance
        code, correction = _CODES[reading.outcome], reading.correction
        numbers = received, stamp, float(reading.stamped), float(reading.completed), code
        if correction is None:
            self._rows.append(np.array((*numbers, nan)), reading.values, covariance, None, None)
            return
        v, S = correction.innovation, correction.innovation_covariance
        self._rows.append(np.array((*numbers, correction.nis)), reading.values, covariance, v, S)

    def add_fused(
        self,
        readings: Readings,
        received: Array,
        stamp: Array,
        innovation: Array,
        S: Array,
        nis: Array,
    ) -> None:
        """Add readings that were fused, with times of receipt and stamps in seconds."""
        count = len(received)
        stamped, fused = float(readings.time is not None), _CODES[Outcome.FUSED]
        columns = (
            received, stamp, np.full(count, stamped), readings.completed, np.full(count, fused),
            nis,
        )  # fmt: skip
        self._rows.extend(
            np.column_stack(columns), readings.values, readings.covariance, innovation, S
        )

    def result(self, counts: dict[Outcome, int], undecodable: int) -> SensorReplay:
        """Return all readings."""
        columns = self._rows.columns()
        received, stamp, stamped, completed, code, nis = columns['numbers'].T
        names = np.array([outcome.name for outcome in _OUTCOMES])
        return SensorReplay(
            received=received,
            stamp=stamp,
            stamped=stamped > 0.0,
            completed=completed > 0.0,
            value=columns['value'],
            covariance=columns['covariance'],
            outcome=names[code.astype(int)],
            innovation=columns['innovation'],
            innovation_covariance=columns['expected'],
            nis=nis,
            counts=counts,
            undecodable=undecodable,
        )


class BeliefColumns:
    """Beliefs over time."""

    def __init__(self, size: int) -> None:
        self._rows = Rows(time=(1,), mean=(size,), covariance=(size, size))

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, time: float, belief: Gaussian) -> None:
        """Add a belief at a time in seconds."""
        self._rows.append(np.array((time,)), belief.mean, belief.covariance)

    def extend(self, time: Array, mean: Array, covariance: Array) -> None:
        """Add beliefs at times (N,)."""
        self._rows.extend(time, mean, covariance)

    def result(self) -> Beliefs:
        """Return all beliefs."""
        columns = self._rows.columns()
        return Beliefs(columns['time'][:, 0], columns['mean'], columns['covariance'])


class InputColumns:
    """Inputs over time."""

    def __init__(self, size: int) -> None:
        self._rows = Rows(received=(1,), stamp=(1,), value=(size,))

    def add(self, received: float, stamp: float, u: Array) -> None:
        """Add an input."""
        self._rows.append(np.array(received), np.array(stamp), u)

    def extend(self, received: Array, stamp: Array, u: Array) -> None:
        """Add inputs (N, m)."""
        self._rows.extend(received, stamp, u)

    def result(self) -> InputRecord:
        """Return all inputs."""
        columns = self._rows.columns()
        return InputRecord(columns['received'][:, 0], columns['stamp'][:, 0], columns['value'])


class EstimateRecording:
    """Recording of the topics that the estimator publishes.

    Parameters
    ----------
    writer
        Writer of the recording.
    settings
        Settings of the estimator.
    resolve
        Function that returns the full name of a topic.
    origin
        Datum of satellite fixes.
    """

    def __init__(
        self,
        writer: RecordingWriter,
        settings: Settings,
        resolve: Callable[[str], str],
        origin: Origin,
    ) -> None:
        scenario, options = settings.scenario, settings.options
        self._writer, self._resolve = writer, resolve
        topics = self._topics = EstimateTopics(scenario, options.frame, options.child_frame)
        self._innovations = {
            name: InnovationTopic(scenario.state, name, source.sensor.output)
            for name, source in scenario.enabled.items()
        }
        self._globe = GlobalTopics(scenario, options, origin)
        for signal in self._globe.signals:
            writer.add(resolve(signal.topic), full_type(signal.type))
        outputs = [topics.estimate, topics.state, topics.covariance]
        for topic in (*outputs, *(innovation.topic for innovation in self._innovations.values())):
            writer.add(resolve(topic.name), full_type(topic.signal.type))
        self._odometry = None
        if options.publish_odometry:
            self._odometry = OdometryTopic(scenario, options.frame, options.child_frame)
            signal = self._odometry.signal
            writer.add(resolve(signal.topic), full_type(signal.type))

    def publish(self, received: int, time: int, belief: Gaussian) -> None:
        """Write a belief at ``time``, after a message ``received`` then; both in nanoseconds."""
        topics, (x, P) = self._topics, belief
        self._write(topics.estimate, received, topics.estimate.write(time, x, P))
        self._write(topics.state, received, topics.state.write(time, x))
        self._write(topics.covariance, received, topics.covariance.write(time, P.ravel()))
        if self._odometry is not None:
            message = self._odometry(time, belief)
            self._write_on(self._odometry.signal.topic, received, message)
        for signal, message in self._globe(time, belief):
            self._write_on(signal.topic, received, message)
        if self._writer.waiting > _FLUSH:
            self._writer.flush()

    def publish_innovation(self, received: int, reading: Reading) -> None:
        """Write the innovation of a reading, if it has a finite one."""
        if reading.correction is not None and reading.correction.nis < inf:
            write = self._innovations[reading.source]
            message = write(reading.time, reading.correction)
            if message is not None:
                self._write(write.topic, received, message)

    def _write(self, topic: Topic, received: int, message: Any) -> None:
        self._write_on(topic.name, received, message)

    def _write_on(self, topic: str, received: int, message: Any) -> None:
        self._writer.write(self._resolve(topic), received, _serialised(message))


def _serialised(message: Any) -> bytes:
    """Return a message as it is on the wire, with zeros for padding."""
    if isinstance(message, bytes):
        return message
    try:
        return without_padding(bytes(serialize_message(message)), message)
    except NotImplementedError:
        return bytes(serialize_message(message))


def add_all(
    fused: Sequence[Reading], into: dict[str, SensorColumns], received: int, start: int
) -> None:
    """Add the readings that were fused together."""
    for reading in fused:
        into[reading.source].add(reading, seconds(received, start), seconds(reading.time, start))
