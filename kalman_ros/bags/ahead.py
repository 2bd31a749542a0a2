# SPDX-License-Identifier: Apache-2.0
"""Messages of a recording, decoded before they are processed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kalman_ros.codecs.messages import UndecodableError
from kalman_ros.estimators.arrivals import Arrivals
from kalman_ros.estimators.online import is_covariance
from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.pipeline.reading import Reading, Readings
from kalman_ros.pipeline.reading_reader import SensorReader
from kalman_ros.scenario import SensorSource

from .blocks import Message, Messages

#: Source of a delivery that cannot be taken with others.
_ALONE = -1


class Ahead:
    """Messages that follow each other, decoded by columns where that is possible.

    Each is delivered to every sensor that reads it, or once to the readers of any other.

    Parameters
    ----------
    messages
        Messages in the order of receipt.
    fuser
        Their fuser, the readers of which decode them.
    sensors, input
        Topic of each sensor, which several may share, and of the input; '' for one that is not
        decoded ahead.
    longest
        Longest message that is decoded, in bytes.
    """

    def __init__(
        self,
        messages: Messages,
        fuser: Fuser,
        sensors: Mapping[str, str],
        input: str,
        longest: int,
    ) -> None:
        self._messages, self._names = messages, [*sensors]
        self._of, self._reader = _deliveries(messages, [*sensors.values(), input], longest)
        now = np.array(messages.time, dtype=np.int64)[self._of]
        self._time, self._source = now.copy(), np.full(len(now), _ALONE)
        self._row = np.zeros(len(now), dtype=int)
        #: Readings by the index of their delivery, that were decoded one by one.
        self.known: dict[int, Reading] = {}
        #: Indices of the deliveries that cannot be decoded.
        self.undecodable: set[int] = set()
        #: Decoded messages of each sensor.
        self.readings: list[Readings] = []
        for index, name in enumerate(sensors):
            channel, source = fuser.channels[name], fuser.scenario.sensors[name]
            self.readings.append(self._read(channel, source, index))
        acting = np.flatnonzero(self._reader == len(sensors))
        samples = fuser.input.read_all(self._data(acting)) if len(acting) else None
        self.inputs = np.empty((0, fuser.scenario.model.input.size))
        if samples is not None:
            self._place(acting, len(sensors), samples.time)
            self.inputs = samples.values
        values = [*(readings.values for readings in self.readings), self.inputs]
        covariances = [readings.covariance for readings in self.readings]
        #: All deliveries; the source of one that cannot be taken with others is negative.
        self.arrivals = Arrivals(self._time, now, self._source, self._row, values, covariances)

    def __len__(self) -> int:
        return len(self._of)

    def delivery(self, at: int) -> tuple[Message, str]:
        """Return the message of a delivery, and its sensor; '' for the readers of any other."""
        index, reader = int(self._of[at]), int(self._reader[at])
        name = self._names[reader] if 0 <= reader < len(self._names) else ''
        return self._messages[index], name

    def _data(self, at: Any) -> list[bytes]:
        data = self._messages.data
        return [data[index] for index in self._of[at].tolist()]

    def _place(self, at: Any, source: int, time: Any) -> None:
        """Enter the messages of a source at their places, with stamps if they have them."""
        self._source[at], self._row[at] = source, np.arange(len(at))
        if time is not None:
            self._time[at] = np.where(time, time, self._time[at])

    def _read(self, channel: SensorReader, source: SensorSource, index: int) -> Readings:
        """Return the readings of a sensor, and enter them."""
        at = np.flatnonzero(self._reader == index)
        readings = channel.read_all(self._data(at), source) if len(at) else None
        if readings is None:
            at, readings = self._read_each(channel, source, at)
        self._place(at, index, readings.time)
        return readings

    def _read_each(
        self, channel: SensorReader, source: SensorSource, at: Any
    ) -> tuple[Any, Readings]:
        """Return the readings of messages that are decoded one by one, with their places."""
        R, usable = source.sensor.covariance, []
        for index, data in zip(at.tolist(), self._data(at)) if channel.is_settled else ():
            try:
                reading = self.known[index] = channel.read(data, source)
            except UndecodableError:
                self.undecodable.add(index)
                continue
            C = reading.covariance
            sound = C is None or is_covariance(C, len(R))
            if reading.outcome is None and reading.values.shape == R.shape[:1] and sound:
                usable.append(index)
        read = [self.known[index] for index in usable]
        carried = (reading.covariance for reading in read)
        matrices = [R if C is None else C for C in carried]
        stamped = any(reading.time is not None for reading in read)
        readings = Readings(
            np.array([reading.time or 0 for reading in read]) if stamped else None,
            np.array([reading.values for reading in read]).reshape(-1, len(R)),
            np.array(matrices).reshape(-1, *R.shape),
            np.array([reading.completed for reading in read], dtype=bool),
        )
        return np.array(usable, dtype=int), readings

    def next_message(self, at: int) -> int:
        """Return the index of the first delivery of the message behind that of one."""
        return int(np.searchsorted(self._of, self._of[at], 'right'))

    def first(self, begin: int, most: int) -> Arrivals:
        """Return the deliveries from one on, up to one that cannot be taken with others."""
        alone = self.arrivals.source[begin : begin + most] == _ALONE
        return self.arrivals.some(slice(begin, begin + int(np.argmax(np.append(alone, True)))))


def _deliveries(messages: Messages, topics: Sequence[str], longest: int) -> tuple[Any, Any]:
    """Return the message of each delivery and its reader, by their indices.

    A message that is too long, or on none of the topics, is delivered once; its reader is -1.
    """
    codes = {topic: code for code, topic in enumerate(topics) if topic}
    code = np.array([codes.get(topic, -1) for topic in messages.topic])
    code[np.array([*map(len, messages.data)]) > longest] = -1
    read_by = [np.flatnonzero(code == codes.get(topic, len(topics))) for topic in topics]
    others = np.flatnonzero(code < 0)
    of = np.concatenate((others, *read_by))
    reader = np.repeat(np.arange(-1, len(topics)), [len(others), *map(len, read_by)])
    order = np.lexsort((reader, of))
    return of[order], reader[order]
