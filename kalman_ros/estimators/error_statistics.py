# SPDX-License-Identifier: Apache-2.0
"""Truth beside estimate, readings and inputs, matched by their stamps as they come."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, Space

from .consistency import NeesWindow

#: So many instants are kept for what has not come yet.
_KEPT = 2000


class MeanSquare:
    """The root of the mean square of vectors (n,), over all that were added."""

    def __init__(self, size: int) -> None:
        self._sum = np.zeros(size)
        self.count = 0

    def add(self, error: Array) -> None:
        """Take one vector in."""
        self._sum += error * error
        self.count += 1

    @property
    def root(self) -> Array:
        """The root mean square (n,); NaN before the first."""
        if not self.count:
            return np.full(self._sum.size, np.nan)
        return np.sqrt(self._sum / self.count)


class Comparison:
    """Compares what an estimator says with what really happened.

    Parameters
    ----------
    state
        The space of the state.
    sensors
        By name; their raw error is the reading minus what the truth would have given.
    weight
        Of the cost of a sample: (n + m, n + m), for the stacked state and input.
    length
        The number of estimates over which the NEES is averaged.
    """

    def __init__(
        self, state: Space, sensors: Mapping[str, Sensor], weight: Array, length: int
    ) -> None:
        self._space, self._sensors, self._weight = state, dict(sensors), weight
        self.error = MeanSquare(state.size)
        self.raw = {name: MeanSquare(s.output.size) for name, s in self._sensors.items()}
        self.fused = {name: MeanSquare(s.output.size) for name, s in self._sensors.items()}
        self.nees = NeesWindow(state.size, length)
        self.cost = 0.0
        self.steps = 0
        self._truths: dict[int, Array] = {}
        self._waiting: dict[tuple[str, int], Any] = {}

    def truth(self, time: int, x: Array) -> None:
        """Take in the true state (n,) at ``time``, in nanoseconds.

        A time that goes back means that another run has begun: what waits is forgotten.
        """
        if self._truths and time < next(reversed(self._truths)):
            self._truths.clear()
            self._waiting.clear()
        self._truths[time] = x
        for kind in ('estimate', 'input', *self._sensors):
            item = self._waiting.pop((kind, time), None)
            if item is not None:
                self._compare(kind, item, x)
        for kept in (self._truths, self._waiting):
            while len(kept) > _KEPT:
                kept.pop(next(iter(kept)))  # type: ignore[call-overload]

    def estimate(self, time: int, belief: Gaussian) -> None:
        """Take in an estimate that holds at ``time``."""
        self._take('estimate', time, belief)

    def input(self, time: int, u: Array) -> None:
        """Take in the input (m,) from ``time`` on."""
        self._take('input', time, u)

    def reading(self, name: str, time: int, y: Array) -> None:
        """Take in a reading of the sensor ``name``."""
        self._take(name, time, y)

    def _take(self, kind: str, time: int, item: Any) -> None:
        truth = self._truths.get(time)
        if truth is None:
            self._waiting[kind, time] = item
        else:
            self._compare(kind, item, truth)

    def _compare(self, kind: str, item: Any, x: Array) -> None:
        if kind == 'estimate':
            self._compare_estimate(item, x)
        elif kind == 'input':
            z = np.concatenate((x, item))
            self.cost += float(z @ self._weight @ z)
            self.steps += 1
        else:
            sensor = self._sensors[kind]
            self.raw[kind].add(sensor.output.subtract(item, sensor.measure(x)))

    def _compare_estimate(self, belief: Gaussian, x: Array) -> None:
        error = self._space.subtract(x, belief.mean)
        self.error.add(error)
        for name, sensor in self._sensors.items():
            difference = sensor.output.subtract(sensor.measure(belief.mean), sensor.measure(x))
            self.fused[name].add(difference)
        if np.isnan(belief.covariance).any():  # nobody said how good it is
            return
        self.nees.add_error(error, belief.covariance)
