# SPDX-License-Identifier: Apache-2.0
"""Confirmation of recorded steps in lockstep, and removal of repeated messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from sensor_msgs.msg import TimeReference

from kalman_ros.codecs.messages import leading_stamp, message_type
from kalman_ros.codecs.tick import mentioned, read_tick, write_tick
from kalman_ros.core import Signal
from kalman_ros.nodes.middleware.topics import QUEUE
from kalman_ros.pipeline.estimate_topics import covariance_signal
from kalman_ros.scenario import Scenario

from .recorder import QUEUE as RECORDING
from .recorder import Recorder
from .run_recording import RunRecording

#: Largest number of steps by which the plant may be ahead of the recorder. Writers keep 1000.
WINDOW = 250
#: Number of readings of a sensor that may be in transit when a step is confirmed.
_UNDER_WAY = 500
#: Interval of checks in seconds, and number of checks after which a confirmation is repeated.
_PERIOD, _LOOKS = 0.01, 20


class Confirmation:
    """A publisher, on ``recorded``, of the last step of which a recorder has all messages.

    The message is a `sensor_msgs/TimeReference` with the stamp of the step. A step is confirmed
    when its truth, estimate, covariance and input are received, if they are published, and at most
    a few readings of each sensor that are named in ticks are missing.

    Only one recorder may take part, since the plant uses the last confirmation that it receives.
    """

    def __init__(self, node: Any, scenario: Scenario, recorder: Recorder) -> None:
        self._recorder, self._scenario = recorder, scenario
        self._period = round(1e9 / scenario.rate)
        signals = [scenario.state, *([scenario.input] if scenario.input.fields else ())]
        #: Topics with one message per step, which has its stamp.
        self._stamped = ['ground_truth', *(s.topic for s in signals if _has_stamp(s))]
        self._readings = {source.signal.topic for source in scenario.sensors.values()}
        self._full: Callable[[str], str] = node.resolve_topic_name
        self._named = dict.fromkeys(self._readings, 0)
        self._first: int | None = None
        self._ticks: list[bytes] = []
        self._recording: RunRecording | None = None
        self._confirmed, self._looks = -1, 0
        self._count = node.count_publishers
        self._publisher = node.create_publisher(TimeReference, 'recorded', QUEUE)
        self._subscription = node.watch(TimeReference, 'tick', self._on_tick, RECORDING)
        node.create_timer(_PERIOD, self._confirm, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def topic(self) -> str:
        """Full name of the topic of the ticks."""
        return str(self._subscription.topic_name)

    def write_to(self, recording: RunRecording) -> None:
        """Write all further ticks into a recording, too."""
        recording.add(self._subscription)
        self._recording = recording

    def _on_tick(self, data: bytes) -> None:
        time, topics = read_tick(data)
        if self._recording is not None:
            self._recording.write(self.topic, data)
        self._ticks.append(data)
        if self._first is None:
            self._first = time
        for topic in topics:
            name, _ = mentioned(topic, time)
            if name in self._named:
                self._named[name] += 1

    def _confirm(self) -> None:
        """Publish the last complete step if it has changed or if the last message is old."""
        self._looks += 1
        complete = self._last_complete_step()
        if complete is None:
            return
        changed = abs(complete - self._confirmed) >= WINDOW // 5 * self._period
        if not changed and self._looks < _LOOKS:
            return
        self._confirmed, self._looks = complete, 0
        self._publisher.publish(write_tick(complete, ()))

    def _last_complete_step(self) -> int | None:
        """Return the stamp of the last complete step; None if it is not known."""
        received = self._recorder.received
        for topic, count in self._named.items():
            if count - received.get(self._full(topic), 0) > _UNDER_WAY:
                return None
        raw = self._recorder.raw
        recorded = [topic for topic in self._stamped if raw[topic]]
        absent = [topic for topic in self._stamped if not raw[topic]]
        if self._first is None or any(map(self._count, absent)):
            return self._first
        return min((leading_stamp(raw[topic][-1]) for topic in recorded), default=None)

    def drop_repeated(self) -> None:
        """Drop recorded messages that are repeated because the plant requested a step twice."""
        times = [leading_stamp(data) for data in self._ticks]
        flags = [earlier == later for earlier, later in pairwise([-1, *times])]
        if not any(flags):
            return
        raw = self._recorder.raw
        self._drop_readings(flags)
        estimate, input = self._scenario.state, self._scenario.input
        covariance = covariance_signal(estimate).topic
        repeated = _repeated(raw[estimate.topic])
        if len(raw[covariance]) == len(repeated):
            _drop(raw[covariance], repeated)
        if input.fields and not _has_stamp(input):
            _drop_equal(raw[input.topic], len(repeated) - sum(repeated))
        for topic in self._stamped:
            _drop(raw[topic], _repeated(raw[topic]))

    def _drop_readings(self, tick_flags: list[bool]) -> None:
        """Drop repeated ticks, and the readings that they name."""
        repeats: dict[str, list[bool]] = {topic: [] for topic in self._readings}
        for data, repeated in zip(self._ticks, tick_flags):
            time, topics = read_tick(data)
            for name in (mentioned(topic, time)[0] for topic in topics):
                if name in repeats:
                    repeats[name].append(repeated)
        for topic, flags in repeats.items():
            if flags:  # a disabled sensor is not recorded
                _drop(self._recorder.raw[topic], flags)
        _drop(self._ticks, tick_flags)


def _has_stamp(signal: Signal) -> bool:
    return hasattr(message_type(signal.type), 'header')


def _repeated(messages: Sequence[bytes]) -> list[bool]:
    """Return whether the stamp of each message equals that of the previous message."""
    stamps = [-1, *map(leading_stamp, messages)]
    return [before == stamp for before, stamp in pairwise(stamps)]


def _drop(messages: list[bytes], flags: Sequence[bool]) -> None:
    """Drop the messages whose flag is set; keep messages without a flag."""
    messages[: len(flags)] = [data for data, drop in zip(messages, flags) if not drop]


def _drop_equal(messages: list[bytes], count: int) -> None:
    """Drop messages that equal the previous message until ``count`` messages are left.

    One estimate has one answer, so a repeated answer without a stamp has equal bytes.
    """
    surplus = len(messages) - count
    kept: list[bytes] = []
    for data in messages:
        if surplus > 0 and kept and data == kept[-1]:
            surplus -= 1
        else:
            kept.append(data)
    messages[:] = kept
