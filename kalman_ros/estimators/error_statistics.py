# SPDX-License-Identifier: Apache-2.0
"""Comparison of the truth with estimates, readings and inputs of the same stamp."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, Space

from .consistency import NeesWindow

#: The number of instants kept while waiting for their counterpart.
_KEPT = 2000
#: The number of pairs compared in one call; single comparisons take many times as long.
_TOGETHER = 500
#: An estimate that is older than the newest truth by more, in ns, has no truth of its stamp.
_LATE = 1_000_000_000


class MeanSquare:
    """The root mean square of vectors (n,)."""

    def __init__(self, size: int) -> None:
        self._sum = np.zeros(size)
        self.count = 0

    def add(self, errors: Array) -> None:
        """Add vectors (N, n)."""
        self._sum += (errors * errors).sum(axis=0)
        self.count += len(errors)

    @property
    def root(self) -> Array:
        """The root mean square (n,); NaN before the first vector."""
        if not self.count:
            return np.full(self._sum.size, np.nan)
        return np.sqrt(self._sum / self.count)


class Comparison:
    """Comparison of an estimator with the truth; call `settle` before reading the results.

    Parameters
    ----------
    state
        Space of the state.
    sensors
        Sensors by name; their raw error is the reading minus the noise-free reading of the truth.
    weight
        Cost weight of a sample (n + m, n + m), for the stacked state and input.
    length
        Number of estimates over which the NEES is averaged.
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
        #: For each of the last estimates, whether there was a truth of its stamp.
        self.compared: deque[bool] = deque(maxlen=length)
        #: Pending pairs of an item and the truth of the same time, by kind.
        self._pairs: dict[str, list[tuple[Any, Array]]] = {
            kind: [] for kind in ('estimate', 'input', *self._sensors)
        }
        self._truths: dict[int, Array] = {}
        self._waiting: dict[tuple[str, int], Any] = {}
        self._first_truth: int | None = None

    def truth(self, time: int, x: Array) -> None:
        """Add the true state (n,) at ``time``, in nanoseconds.

        A time that goes back means another run: pending items are dropped.
        """
        if self._truths and time < next(reversed(self._truths)):
            self._truths.clear()
            self._waiting.clear()
            self._first_truth = None
        if self._first_truth is None:
            self._first_truth = time
        self._truths[time] = x
        for kind in ('estimate', 'input', *self._sensors):
            item = self._waiting.pop((kind, time), None)
            if item is not None:
                self._compare(kind, item, x)
        self._drop_unmatched(time - _LATE)
        for kept in (self._truths, self._waiting):
            while len(kept) > _KEPT:
                kept.pop(next(iter(kept)))  # type: ignore[call-overload]

    def _drop_unmatched(self, before: int) -> None:
        """Drop pending items older than a time: their truth was lost."""
        while self._waiting:
            kind, time = next(iter(self._waiting))
            if time >= before:
                return
            del self._waiting[kind, time]
            if kind == 'estimate' and time >= (self._first_truth or 0):
                self.compared.append(False)

    def estimate(self, time: int, belief: Gaussian) -> None:
        """Add an estimate at ``time``; an estimate that is not finite is only counted."""
        if np.isfinite(belief.mean).all():
            self._take('estimate', time, belief)
        else:
            self.compared.append(False)

    def input(self, time: int, u: Array) -> None:
        """Add the input (m,) in effect from ``time``."""
        self._take('input', time, u)

    def reading(self, name: str, time: int, y: Array) -> None:
        """Add a reading of the sensor ``name``."""
        self._take(name, time, y)

    def _take(self, kind: str, time: int, item: Any) -> None:
        truth = self._truths.get(time)
        if truth is None:
            self._waiting[kind, time] = item
        else:
            self._compare(kind, item, truth)

    def _compare(self, kind: str, item: Any, x: Array) -> None:
        if kind == 'estimate':
            self.compared.append(True)
        pairs = self._pairs[kind]
        pairs.append((item, x))
        if len(pairs) >= _TOGETHER:
            self.settle()

    def settle(self) -> None:
        """Compare all pending pairs."""
        for kind, pairs in self._pairs.items():
            if not pairs:
                continue
            items, truths = zip(*pairs)
            del pairs[:]
            x = np.array(truths)
            if kind == 'estimate':
                self._compare_estimates(items, x)
            elif kind == 'input':
                z = np.hstack((x, np.array(items)))
                self.cost += float(np.einsum('ki,ij,kj->', z, self._weight, z))
                self.steps += len(z)
            else:
                sensor = self._sensors[kind]
                y = np.array(items)
                self.raw[kind].add(sensor.output.subtract(y, sensor.measure(x)))

    def _compare_estimates(self, beliefs: Sequence[Gaussian], x: Array) -> None:
        mean = np.array([belief.mean for belief in beliefs])
        covariance = np.array([belief.covariance for belief in beliefs])
        errors = self._space.subtract(x, mean)
        self.error.add(errors)
        for name, sensor in self._sensors.items():
            differences = sensor.output.subtract(sensor.measure(mean), sensor.measure(x))
            self.fused[name].add(differences)
        known = ~np.isnan(covariance).any(axis=(-2, -1))
        if known.any():
            self.nees.add_errors(errors[known], covariance[known])
