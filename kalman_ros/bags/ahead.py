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
from kalman_ros.pipeline.reading_reader import Reading, Readings, SensorReader
from kalman_ros.scenario import SensorSource

from .blocks import Message

#: Source of a delivery that cannot be taken with others.
_ALONE = -1
#: Readers of a message that is not decoded ahead.
_OTHER = ('',)


class Ahead:
    """Messages that follow each other, decoded by columns where that is possible.

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
        messages: Sequence[Message],
        fuser: Fuser,
        sensors: Mapping[str, str],
        input: str,
        longest: int,
    ) -> None:
        readers: dict[str, list[str]] = {}
        for name, topic in sensors.items():
            readers.setdefault(topic, []).append(name)
        #: Each message, once for each sensor that reads it; '' for the readers of any other.
        self.deliveries = [
            (message, name)
            for message in messages
            for name in (
                readers.get(message.topic, _OTHER) if len(message.data) <= longest else _OTHER
            )
        ]
        now = np.array([message.time for message, _ in self.deliveries], dtype=np.int64)
        self._time, self._source = now.copy(), np.full(len(now), _ALONE)
        self._row = np.zeros(len(now), dtype=int)
        #: Readings by the index of their delivery, that were decoded one by one.
        self.known: dict[int, Reading] = {}
        #: Indices of the deliveries that cannot be decoded.
        self.undecodable: set[int] = set()
        #: Decoded messages of each sensor.
        self.readings: list[Readings] = []
        places: dict[str, list[int]] = {name: [] for name in sensors}
        acting = []
        for at, (message, name) in enumerate(self.deliveries):
            if name:
                places[name].append(at)
            elif message.topic == input and len(message.data) <= longest:
                acting.append(at)
        for index, name in enumerate(sensors):
            channel, source = fuser.channels[name], fuser.scenario.sensors[name]
            self.readings.append(self._read(channel, source, places[name], index))
        samples = fuser.input.read_all(self._data(acting)) if acting else None
        self.inputs = np.empty((0, fuser.scenario.model.input.size))
        if samples is not None:
            self._place(acting, len(sensors), samples.time)
            self.inputs = samples.values
        values = [*(readings.values for readings in self.readings), self.inputs]
        covariances = [readings.covariance for readings in self.readings]
        #: All deliveries; the source of one that cannot be taken with others is negative.
        self.arrivals = Arrivals(self._time, now, self._source, self._row, values, covariances)

    def _data(self, at: Sequence[int]) -> list[bytes]:
        return [self.deliveries[index][0].data for index in at]

    def _place(self, at: Sequence[int], source: int, time: Any) -> None:
        """Enter the messages of a source at their places, with stamps if they have them."""
        self._source[at], self._row[at] = source, np.arange(len(at))
        if time is not None:
            self._time[at] = np.where(time, time, self._time[at])

    def _read(
        self, channel: SensorReader, source: SensorSource, at: list[int], index: int
    ) -> Readings:
        """Return the readings of a sensor, and enter them."""
        readings = channel.read_all(self._data(at), source) if at else None
        if readings is None:
            at, readings = self._read_each(channel, source, at)
        self._place(at, index, readings.time)
        return readings

    def _read_each(
        self, channel: SensorReader, source: SensorSource, at: list[int]
    ) -> tuple[list[int], Readings]:
        """Return the readings of messages that are decoded one by one, with their places."""
        R, usable = source.sensor.covariance, []
        for index in at if channel.is_settled else ():
            try:
                reading = self.known[index] = channel.read(self._data([index])[0], source)
            except UndecodableError:
                self.undecodable.add(index)
                continue
            C = reading.covariance
            sound = C is None or is_covariance(C, len(R))
            if reading.refused is None and reading.values.shape == R.shape[:1] and sound:
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
        return usable, readings

    def next_message(self, at: int) -> int:
        """Return the index of the first delivery of the message behind that of one."""
        message = self.deliveries[at][0]
        behind = range(at + 1, len(self.deliveries))
        return next((k for k in behind if self.deliveries[k][0] is not message), behind.stop)

    def first(self, begin: int, most: int) -> Arrivals:
        """Return the deliveries from one on, up to one that cannot be taken with others."""
        alone = self.arrivals.source[begin : begin + most] == _ALONE
        return self.arrivals.some(slice(begin, begin + int(np.argmax(np.append(alone, True)))))
