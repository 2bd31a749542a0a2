# SPDX-License-Identifier: Apache-2.0
"""The faults of the plants of many runs: each run has its own random numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from kalman_ros.core import Array, TimedSensor, Value

from .actuator import Actuator
from .faults.links import Link
from .faults.plant_faults import PlantFaults
from .noise import stream


class BatchLink:
    """The link of one sensor in each run, without faults that delay.

    Parameters
    ----------
    name, timed
        Name of the sensor, and the sensor.
    seeds
        Seeds of the runs.
    settings
        Settings of its faults.
    """

    def __init__(
        self, name: str, seeds: Sequence[int], timed: TimedSensor, settings: Mapping[str, Value]
    ) -> None:
        self._links = [Link(name, seed) for seed in seeds]
        for link in self._links:
            link.configure(timed, settings)

    def __call__(self, time: int, readings: Array) -> Array:
        """Return what arrives of readings (runs, k) taken at ``time`` (ns), with NaN if lost."""
        arrived: Array = np.full(readings.shape[::-1], np.nan).T
        for index, (link, y) in enumerate(zip(self._links, readings)):
            link.send(time, time, y)
            # a duplicate is not fused
            for arrival in link.arriving(time):
                arrived[index] = arrival.values
        return arrived


class BatchInput:
    """The input of each run: actuator, lost commands, dead zone and disturbances.

    Parameters
    ----------
    faults
        Faults of each plant.
    seeds
        Seeds of the runs.
    """

    def __init__(self, faults: PlantFaults, seeds: Sequence[int]) -> None:
        self._faults = faults.body
        self._loss = [stream(seed, 'fault loss') for seed in seeds]
        self._push = [stream(seed, 'fault disturbance') for seed in seeds]
        self._command = np.zeros((len(seeds), len(faults.gain)))
        self._actuator = Actuator(faults.gain, faults.delay, self._command)

    def __call__(self, step: int, u: Array, dt: float) -> Iterator[tuple[float, Array]]:
        """Yield the acting inputs (runs, m) and their seconds, for a step commanded ``u``."""
        time = step * dt
        faults = self._faults if self._faults.act(time) else None
        command = np.broadcast_to(u, self._command.shape)
        if faults is not None:
            lost = np.array([faults.lose(generator) for generator in self._loss])
            command = np.where(lost[:, np.newaxis], self._command, command)
        self._command = command
        if faults is None:
            yield from self._actuator(command, dt)
            return
        push = np.array([faults.push(time, dt, generator) for generator in self._push])
        for duration, acting in self._actuator(command, dt):
            yield duration, faults.moved(acting) + push
