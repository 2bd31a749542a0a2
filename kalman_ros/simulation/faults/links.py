# SPDX-License-Identifier: Apache-2.0
"""The links from the sensors of a plant to their topics: faults, and readings in transit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from heapq import heappop, heappush
from itertools import count
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, TimedSensor, Value, build_with
from kalman_ros.simulation.noise import stream

from . import FAULTS, settings_of, window_of
from .fault import Fault, Reading

#: Nanoseconds after a step up to which a reading arrives at the step, since times are rounded.
_ROUNDING = 1000


class Arrival(NamedTuple):
    """A reading that arrives: its sensor, its stamp in nanoseconds, its values (k,)."""

    name: str
    stamp: int
    values: Array


class Link:
    """The link of one sensor."""

    def __init__(self, name: str, seed: int) -> None:
        self._name, self._seed = name, seed
        self._streams: dict[type[Fault], np.random.Generator] = {}
        self._settings: dict[type[Fault], dict[str, Value]] = {}
        self._faults: dict[type[Fault], Fault] = {}
        self._under_way: list[tuple[int, int, Reading]] = []
        self._number = count()

    @property
    def idle(self) -> bool:
        """Whether readings pass unchanged, and none is in transit."""
        return not self._faults and not self._under_way

    @property
    def faults(self) -> Iterator[str]:
        """Faults that are on, with their settings."""
        for settings in self._settings.values():
            name, value = next(iter(settings.items()))
            yield f'{self._name}.{name}: {value}'

    def configure(self, timed: TimedSensor, values: Mapping[str, Value]) -> None:
        """Replace the faults; a fault with unchanged settings continues."""
        self._wrap, self._window = timed.sensor.output.wrap, window_of(values)
        for kind in FAULTS:
            settings = settings_of(kind, values)
            if settings is None:
                self._faults.pop(kind, None)
                self._settings.pop(kind, None)
            elif settings != self._settings.get(kind):
                self._settings[kind] = settings
                self._faults[kind] = build_with(kind, settings).of(timed, self._stream(kind))
        for fault in self._faults.values():
            fault.timed = timed  # its noise or rate may have changed

    def _stream(self, kind: type[Fault]) -> np.random.Generator:
        name = f'fault {self._name} {kind.__name__}'
        return self._streams.setdefault(kind, stream(self._seed, name))

    def send(self, time: int, stamp: int, y: Array) -> None:
        """Send a reading taken at ``time`` (ns)."""
        reading = Reading(time, stamp, y, (time,))
        if time * 1e-9 in self._window:
            # in the order in which they act, not in which they were enabled
            for kind in FAULTS:
                if kind in self._faults:
                    reading = self._faults[kind](reading)
        reading = reading._replace(values=self._wrap(reading.values))
        for arrival in reading.arrivals:
            heappush(self._under_way, (arrival, next(self._number), reading))

    def arriving(self, time: int) -> Iterator[Arrival]:
        """Yield the arrivals up to ``time`` (ns), in order."""
        while self._under_way and self._under_way[0][0] <= time + _ROUNDING:
            _, _, reading = heappop(self._under_way)
            yield Arrival(self._name, reading.stamp, reading.values)


class Links:
    """The links of all sensors.

    Parameters
    ----------
    seed
        Seed of all noise.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        #: Number of readings that arrived, by sensor.
        self.arrived: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """Remove all faults and readings in transit. Counts are kept."""
        self._links: dict[str, Link] = {}
        self._at: int | None = None
        self._arrivals: list[Arrival] = []

    def configure(
        self, sensors: Mapping[str, TimedSensor], faults: Mapping[str, Mapping[str, Value]]
    ) -> None:
        """Replace the faults, by sensor."""
        for name, timed in sensors.items():
            link = self._links.setdefault(name, Link(name, self._seed))
            link.configure(timed, faults.get(name, {}))

    @property
    def faults(self) -> list[str]:
        """Faults that are on."""
        return [fault for link in self._links.values() for fault in link.faults]

    def __call__(self, time: int, stamp: int, readings: Mapping[str, Array]) -> list[Arrival]:
        """Return the arrivals at a step; a repeated call returns the same.

        Parameters
        ----------
        time
            Time of the step, in nanoseconds since the plant started.
        stamp
            Stamp of the messages.
        readings
            Readings taken at this step, by sensor.
        """
        if time != self._at:
            self._at, self._arrivals = time, list(self._arriving(time, stamp, readings))
            for name, _, _ in self._arrivals:
                self.arrived[name] += 1
        return self._arrivals

    def _arriving(self, time: int, stamp: int, readings: Mapping[str, Array]) -> Iterator[Arrival]:
        for name, link in self._links.items():
            y = readings.get(name)
            if link.idle:
                if y is not None:
                    yield Arrival(name, stamp, y)
                continue
            if y is not None:
                link.send(time, stamp, y)
            yield from link.arriving(time)
