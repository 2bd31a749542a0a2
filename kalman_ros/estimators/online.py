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
from math import isfinite
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, is_finite

from .correction import Correction
from .factor import cholesky
from .filter import Filter
from .outcome import Outcome
from .policy import Policy


class _State(NamedTuple):
    """The belief at a time, the input in effect from then on, and rejections in a row."""

    time: int | None
    belief: Gaussian
    u: Array
    rejections: tuple[int, ...]


class _Item:
    """A reading, or an input (``sensor`` None), and where it left the estimator.

    It keeps the filter that there was when it came, as it does the sensor.
    """

    __slots__ = (
        'after', 'correction', 'filter', 'key', 'outcome', 'restarted', 'sensor', 'value'
    )  # fmt: skip

    def __init__(
        self, key: tuple[int, int], value: Array, sensor: Sensor | None, filter: Filter
    ) -> None:
        self.key = key
        self.value = value
        self.sensor = sensor
        self.filter = filter
        self.outcome = Outcome.FUSED
        self.restarted = False
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
        The belief at the first stamp that comes, and whenever the estimator starts anew.
    input
        The input (m,) in effect until the first one arrives.
    policy
        How to treat what is late, doubtful or missing.
    """

    def __init__(
        self,
        filter: Filter,
        sensors: Mapping[str, Sensor],
        initial: Gaussian,
        input: Array,
        policy: Policy | None = None,
    ) -> None:
        self._order = {name: index for index, name in enumerate(sensors)}
        self._names = list(sensors)
        self.counts: dict[str, Counter[Outcome]] = {name: Counter() for name in sensors}
        self.restarts = 0
        self._first_input = input
        self.configure(filter, sensors, policy or Policy())
        self.reset(initial)

    def configure(self, filter: Filter, sensors: Mapping[str, Sensor], policy: Policy) -> None:
        """Use another filter, sensors of the same names and another policy from now on."""
        self._filter = filter
        self._sensors = dict(sensors)
        self._policy = policy
        self._window = round(policy.window * 1e9)
        self._max_gap = round(policy.max_gap * 1e9)
        self._gates = {self._order[name]: gate for name, gate in (policy.gates or {}).items()}
        self._with_covariance: dict[str, tuple[bytes, Sensor]] = {}

    def reset(self, belief: Gaussian) -> None:
        """Forget what came; the belief holds at the next stamp that comes. Counts go on."""
        self._initial = belief
        self._base = _State(None, belief, self._first_input, (0,) * len(self._order))
        self._items: list[_Item] = []
        self._old_in_a_row = 0

    def restart(self) -> None:
        """Forget what came, for the clock went back, and count that."""
        self.restarts += 1
        self.reset(self._initial)

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
        if head.time is None:
            return head.belief
        return self._predict(head, time, self._filter)

    def add_input(self, time: int, u: Array, now: int | None = None) -> Outcome:
        """Take the input that is in effect from ``time`` on; of one stamp, the last one counts.

        A controller answers twice when two readings of one instant come one after the other.
        ``now`` is when it came, if stamps in the future are to be refused.
        """
        if now is not None and self._is_future(time, now):
            return Outcome.FUTURE
        if u.shape != self._first_input.shape:
            return Outcome.WRONG_SIZE
        if not is_finite(u):
            return Outcome.NOT_FINITE
        return self._insert(_Item((time, len(self._order)), u, None, self._filter))

    def add_reading(
        self,
        name: str,
        time: int,
        y: Array,
        covariance: Array | None = None,
        now: int | None = None,
    ) -> tuple[Outcome, Correction | None]:
        """Take a reading of the sensor ``name``, with its own covariance if it came with one.

        Returns what became of it, and the correction when there was one to compute (also when
        the gate rejected it). ``now`` is when it came, if stamps in the future are to be
        refused.
        """
        outcome, item = self._add_reading(name, time, y, covariance, now)
        self.counts[name][outcome] += 1
        return outcome, None if item is None else item.correction

    def _add_reading(
        self, name: str, time: int, y: Array, covariance: Array | None, now: int | None
    ) -> tuple[Outcome, _Item | None]:
        sensor: Sensor | None = self._sensors[name]
        if y.shape != self._sensors[name].covariance.shape[:1]:
            return Outcome.WRONG_SIZE, None
        if not is_finite(y):
            return Outcome.NOT_FINITE, None
        if covariance is not None:
            sensor = self._noisy(name, covariance)
            if sensor is None:
                return Outcome.BAD_COVARIANCE, None
        if now is not None and self._is_future(time, now):
            return Outcome.FUTURE, None
        item = _Item((time, self._order[name]), y, sensor, self._filter)
        outcome = self._insert(item)
        if outcome is not Outcome.TOO_OLD:
            self._old_in_a_row = 0
            return outcome, item
        self._old_in_a_row += 1
        if self._old_in_a_row != self._policy.restart_after:
            return outcome, item
        self.restart()
        return self._insert(item), item

    def _is_future(self, time: int, now: int) -> bool:
        return time - now > self._policy.future_tolerance * 1e9

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
        if items and item.key <= items[-1].key:
            return self._insert_late(item)
        self._process(item, items[-1].after if items else self._base)
        items.append(item)
        self._forget()
        return item.outcome

    def _insert_late(self, item: _Item) -> Outcome:
        items, time, base = self._items, item.key[0], self._base.time
        # before the base there may be nothing though the window has become wider
        if time < items[-1].key[0] - self._window or (base is not None and time < base):
            return Outcome.TOO_OLD
        index = bisect_left(items, item.key, key=lambda other: other.key)
        if items[index].key == item.key:
            if item.sensor is not None or np.array_equal(items[index].value, item.value):
                return Outcome.DUPLICATE
            del items[index]
        state = self._process(item, items[index - 1].after if index else self._base)
        items.insert(index, item)
        for other in items[index + 1 :]:
            before = other.outcome
            state = self._process(other, state)
            if other.outcome is not before:
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

    def _predict(self, state: _State, time: int, filter: Filter) -> Gaussian:
        """Return the belief at ``time``: the initial one if the old is worth nothing by then."""
        if state.time is None or time == state.time:
            return state.belief
        if self._max_gap and time - state.time > self._max_gap:
            return self._initial
        try:
            return _committed(filter.predict(state.belief, state.u, (time - state.time) * 1e-9))
        except np.linalg.LinAlgError:
            return self._initial

    def _process(self, item: _Item, state: _State) -> _State:
        """Bring ``state`` to the item's time and take the item in."""
        time, order = item.key
        belief = self._predict(state, time, item.filter)
        if belief is self._initial and state.time not in (None, time) and not item.restarted:
            item.restarted = True
            self.restarts += 1
        if item.sensor is None:
            item.after = _State(time, belief, item.value, state.rejections)
            return item.after
        streak = state.rejections[order]
        try:
            first = state.time is None and self._policy.from_reading
            start = _at_its_word(belief, item.value, item.sensor) if first else belief
            item.outcome, item.correction = self._correct(start, item, streak)
            if item.outcome.accepted:
                belief = _committed(item.correction.posterior)
        except np.linalg.LinAlgError:
            item.outcome, item.correction = Outcome.INDEFINITE, None
        rejections = state.rejections
        streak = streak + 1 if item.outcome is Outcome.REJECTED else 0
        if streak != rejections[order]:
            rejections = (*rejections[:order], streak, *rejections[order + 1 :])
        item.after = _State(time, belief, state.u, rejections)
        return item.after

    def _correct(self, belief: Gaussian, item: _Item, streak: int) -> tuple[Outcome, Correction]:
        """Correct by a reading, or reject it; after too many rejections, make it pass."""
        assert item.sensor is not None
        correction = item.filter.correct(belief, item.value, item.sensor)
        gate = self._gates.get(item.key[1])
        if gate is None or correction.nis <= gate:
            return Outcome.FUSED, correction
        if not isfinite(correction.nis):
            raise np.linalg.LinAlgError('the innovation is not finite')
        if not self._policy.recover_after or streak + 1 < self._policy.recover_after:
            return Outcome.REJECTED, correction
        for _ in range(_MOST_WIDENINGS):
            belief = belief._replace(covariance=4.0 * belief.covariance)
            correction = item.filter.correct(belief, item.value, item.sensor)
            if correction.nis <= gate:
                return Outcome.RECOVERED, correction
        return Outcome.REJECTED, correction


#: Fourfold each time, this widens standard deviations by up to a million.
_MOST_WIDENINGS = 20


def _is_covariance(R: Array, size: int) -> bool:
    """Tell whether ``R`` is finite, symmetric and positive definite."""
    if R.shape != (size, size) or not np.isfinite(R).all() or not np.allclose(R, R.T):
        return False
    return bool(np.linalg.eigvalsh(R)[0] > 0.0)


def _committed(belief: Gaussian) -> Gaussian:
    """Return a belief that may be kept: finite, its covariance definite, repaired if need be.

    Raises
    ------
    numpy.linalg.LinAlgError
        If it is neither.
    """
    if not is_finite(belief.mean):
        raise np.linalg.LinAlgError('the estimate is not finite')
    _, P, repairs = cholesky(belief.covariance)
    if not repairs:
        return belief
    return Gaussian(belief.mean, P, belief.repairs + repairs)


def _at_its_word(belief: Gaussian, y: Array, sensor: Sensor) -> Gaussian:
    """Return the belief with what ``sensor`` sees moved to where the reading puts it.

    This is the update without measurement noise, for the mean alone: the reading itself is
    fused afterwards, with its noise.
    """
    x, P = belief.mean, belief.covariance
    H = sensor.jacobian(x)
    # by least squares, for a sensor may see one thing twice
    K = np.linalg.lstsq(H @ P @ H.T, H @ P, rcond=None)[0].T
    return belief._replace(mean=x + K @ sensor.output.subtract(y, sensor.measure(x)))
