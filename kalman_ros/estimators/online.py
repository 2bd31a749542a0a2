# SPDX-License-Identifier: Apache-2.0
"""A filter in time: order, late data, known inputs, gates and an account of every reading.

One plain class that a node, a replay of a log and a Monte Carlo study share. Times are whole
nanoseconds, as ROS stamps are, so that no difference of times is rounded.

The estimator keeps what came within a window as a list in the order of the stamps, with the
belief after each item. An item that arrives late is put in its place and what follows is done
again, by the same operations that arrival in order would have taken; so the result does not
depend on the order of arrival.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import isfinite

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor

from .filter import Correction, Filter


class Outcome(Enum):
    """What became of a reading. Every reading has exactly one."""

    FUSED = 'fused'
    REJECTED = 'rejected: outside the gate'
    INDEFINITE = 'rejected: the update has no finite positive result'
    NOT_FINITE = 'dropped: not finite'
    WRONG_SIZE = 'dropped: wrong size'
    BAD_COVARIANCE = 'dropped: covariance not positive definite'
    DUPLICATE = 'dropped: a reading with this stamp was there'
    TOO_OLD = 'dropped: older than the window'

    @property
    def accepted(self) -> bool:
        """Whether the reading moved the estimate."""
        return self is Outcome.FUSED


@dataclass(frozen=True)
class _State:
    """The belief at a time, and the input in effect from then on."""

    time: int | None
    belief: Gaussian
    u: Array


class _Item:
    """A reading, or an input (``sensor`` None), and where it left the estimator."""

    __slots__ = ('after', 'correction', 'key', 'outcome', 'sensor', 'value')

    def __init__(self, key: tuple[int, int], value: Array, sensor: Sensor | None) -> None:
        self.key = key
        self.value = value
        self.sensor = sensor
        self.outcome = Outcome.FUSED
        self.correction: Correction | None = None
        self.after: _State


class OnlineEstimator:
    """Runs a `Filter` on stamped readings and inputs, in whatever order they arrive.

    Parameters
    ----------
    filter
        The filter; it is told nothing about time but steps.
    sensors
        By name, in the order in which readings with one stamp are fused.
    initial
        The belief at the first stamp that comes.
    input
        The input (m,) in effect until the first one arrives.
    window
        Seconds for which late items are taken in; 0 takes only what comes in order.
    gates
        For some sensors, the largest normalised innovation squared that is fused.
    """

    def __init__(
        self,
        filter: Filter,
        sensors: Mapping[str, Sensor],
        initial: Gaussian,
        input: Array,
        *,
        window: float = 1.0,
        gates: Mapping[str, float] | None = None,
    ) -> None:
        self._order = {name: index for index, name in enumerate(sensors)}
        self._names = list(sensors)
        self._window = round(window * 1e9)
        self.counts: dict[str, Counter[Outcome]] = {name: Counter() for name in sensors}
        self._first_input = input
        self.configure(filter, sensors, gates or {})
        self.reset(initial)

    def configure(
        self, filter: Filter, sensors: Mapping[str, Sensor], gates: Mapping[str, float]
    ) -> None:
        """Use another filter, sensors of the same names and other gates from now on."""
        self._filter = filter
        self._sensors = dict(sensors)
        self._gates = {self._order[name]: gate for name, gate in gates.items()}
        self._with_covariance: dict[str, tuple[bytes, Sensor]] = {}

    def reset(self, belief: Gaussian) -> None:
        """Forget what came; the belief holds at the next stamp that comes. Counts go on."""
        self._base = _State(None, belief, self._first_input)
        self._items: list[_Item] = []

    @property
    def _head(self) -> _State:
        return self._items[-1].after if self._items else self._base

    @property
    def time(self) -> int | None:
        """The stamp of the newest item, in nanoseconds; None before the first."""
        return self._head.time

    @property
    def belief(self) -> Gaussian:
        """The belief at `time`."""
        return self._head.belief

    def predicted(self, time: int) -> Gaussian:
        """Return the belief at a ``time`` not before the newest stamp; nothing is kept."""
        head = self._head
        return self._predict(head, time) if head.time is not None else head.belief

    def add_input(self, time: int, u: Array) -> Outcome:
        """Take the input that is in effect from ``time`` on."""
        if u.shape != self._first_input.shape:
            return Outcome.WRONG_SIZE
        if not np.isfinite(u).all():
            return Outcome.NOT_FINITE
        return self._insert(_Item((time, len(self._order)), u, None))

    def add_reading(
        self, name: str, time: int, y: Array, covariance: Array | None = None
    ) -> tuple[Outcome, Correction | None]:
        """Take a reading of the sensor ``name``, with its own covariance if it came with one.

        Returns what became of it, and the correction when there was one to compute (also when
        the gate rejected it).
        """
        sensor: Sensor | None = self._sensors[name]
        item: _Item | None
        if y.shape != self._sensors[name].covariance.shape[:1]:
            outcome, item = Outcome.WRONG_SIZE, None
        elif not np.isfinite(y).all():
            outcome, item = Outcome.NOT_FINITE, None
        elif covariance is not None and (sensor := self._noisy(name, covariance)) is None:
            outcome, item = Outcome.BAD_COVARIANCE, None
        else:
            item = _Item((time, self._order[name]), y, sensor)
            outcome = self._insert(item)
        self.counts[name][outcome] += 1
        return outcome, item.correction if item is not None else None

    def _noisy(self, name: str, covariance: Array) -> Sensor | None:
        """Return the sensor with this noise, None if it is no covariance; the last is kept."""
        key = covariance.tobytes()
        last = self._with_covariance.get(name)
        if last is not None and last[0] == key:
            return last[1]
        sensor = self._sensors[name]
        if not _is_covariance(covariance, len(sensor.covariance)):
            return None
        sensor = sensor.with_covariance(covariance)
        self._with_covariance[name] = (key, sensor)
        return sensor

    def _insert(self, item: _Item) -> Outcome:
        items = self._items
        if not items or item.key > items[-1].key:
            if self._base.time is not None and item.key[0] < self._base.time:
                return Outcome.TOO_OLD
            items.append(item)
            self._process(item, items[-2].after if len(items) > 1 else self._base)
            self._forget()
            return item.outcome
        return self._insert_late(item)

    def _insert_late(self, item: _Item) -> Outcome:
        items = self._items
        oldest = items[-1].key[0] - self._window
        if item.key[0] < max(oldest, self._base.time or oldest):
            return Outcome.TOO_OLD
        index = bisect_left(items, item.key, key=lambda other: other.key)
        if items[index].key == item.key:
            return Outcome.DUPLICATE
        items.insert(index, item)
        state = items[index - 1].after if index else self._base
        for other in items[index:]:
            before = other.outcome
            state = self._process(other, state)
            if other is not item and other.outcome is not before:
                counts = self.counts[self._names[other.key[1]]]
                counts[before] -= 1
                counts[other.outcome] += 1
        return item.outcome

    def _forget(self) -> None:
        """Drop what is older than the window; the last of it becomes the base."""
        items = self._items
        oldest = items[-1].key[0] - self._window
        gone = 0
        while gone < len(items) - 1 and items[gone].key[0] < oldest:
            gone += 1
        if gone > 16 or (gone and self._window == 0):
            self._base = items[gone - 1].after
            del items[:gone]

    def _predict(self, state: _State, time: int) -> Gaussian:
        if state.time is None or time == state.time:
            return state.belief
        return self._filter.predict(state.belief, state.u, (time - state.time) * 1e-9)

    def _process(self, item: _Item, state: _State) -> _State:
        """Bring ``state`` to the item's time and take the item in."""
        time, order = item.key
        belief = self._predict(state, time)
        if item.sensor is None:
            item.after = _State(time, belief, item.value)
            return item.after
        try:
            correction = self._filter.correct(belief, item.value, item.sensor)
        except np.linalg.LinAlgError:
            item.outcome, item.correction = Outcome.INDEFINITE, None
        else:
            item.correction = correction
            gate = self._gates.get(order)
            if gate is not None and not correction.nis <= gate:
                item.outcome = Outcome.REJECTED
            elif not _is_belief(correction.posterior):
                item.outcome = Outcome.INDEFINITE
            else:
                item.outcome, belief = Outcome.FUSED, correction.posterior
        item.after = _State(time, belief, state.u)
        return item.after


def _is_covariance(R: Array, size: int) -> bool:
    """Tell whether ``R`` is finite, symmetric and positive definite."""
    if R.shape != (size, size) or not np.isfinite(R).all() or not np.allclose(R, R.T):
        return False
    return bool(np.linalg.eigvalsh(R)[0] > 0.0)


def _is_belief(belief: Gaussian) -> bool:
    """Tell whether a belief is finite with non-negative variances."""
    x, P = belief.mean, belief.covariance
    # a sum is finite only if every term is, and cheaper to test
    return isfinite(x.sum() + P.sum()) and float(np.min(P.diagonal())) >= 0.0
