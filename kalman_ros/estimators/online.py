# SPDX-License-Identifier: Apache-2.0
"""A filter in time: order, late data, known inputs, gates and an account of every reading.

One plain class that a node, a replay of a log and a Monte Carlo study share. Times are whole
nanoseconds, as ROS stamps are, so that no difference of times is rounded.

The estimator keeps what came within a window as a list in the order of the stamps, with the
belief after each item. An item that arrives late is put in its place and what follows is done
again, by the same operations that arrival in order would have taken; so the result does not
depend on the order of arrival. Of what arrives together all is put in its place first, so that
what follows is done again once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, is_finite
from kalman_ros.linear.factor import cholesky
from kalman_ros.linear.kernels import is_definite

from . import agreement
from .correction import Correction
from .filter import Filter
from .gate import Gate
from .outcome import Outcome
from .policy import Policy
from .start import taken_at_its_word
from .timeline import Arrival, Item, State, Timeline

#: In nanoseconds: old readings mean that the clock went back only if none has been up to date for
#: this long.
_OUTDATED = 250_000_000


class OnlineEstimator:
    """Runs a `Filter` on stamped readings and inputs, in whatever order they arrive.

    Parameters
    ----------
    filter
        The filter; it is told nothing about time but steps.
    sensors
        By name, in the order in which readings with one stamp are fused.
    initial
        The belief at the first stamp that comes, and whenever the estimator restarts.
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
        self._zero = input
        self.configure(filter, sensors, policy or Policy())
        self.reset(initial)

    def configure(self, filter: Filter, sensors: Mapping[str, Sensor], policy: Policy) -> None:
        """Use another filter, sensors of the same names and another policy from now on."""
        self._filter = filter
        self._sensors = dict(sensors)
        self._policy = policy
        self._window = round(policy.window * 1e9)
        self._max_gap = round(policy.max_gap * 1e9)
        self._gate = Gate({name: sensors[name] for name in self._order}, policy)
        self._with_covariance: dict[str, tuple[bytes, Sensor]] = {}

    def reset(self, belief: Gaussian) -> None:
        """Forget what came; the belief holds at the next stamp that comes. Counts go on."""
        self._initial = belief
        first = None if self._policy.rest_until_input else self._zero
        records = (agreement.Record(),) * len(self._order)
        self._timeline = Timeline(State(None, belief, first, records))
        self._old_in_a_row = 0
        #: When the last reading that was not too old was received, in nanoseconds.
        self._current_at: int | None = None

    def restart(self) -> None:
        """Forget what came, for the clock went back, and count that."""
        self._settle()
        self.restarts += 1
        self.reset(self._initial)

    @property
    def time(self) -> int | None:
        """The stamp of the newest item, in nanoseconds; None before the first."""
        return self._timeline.head.time

    @property
    def belief(self) -> Gaussian:
        """The belief at `time`."""
        return self._timeline.head.belief

    @property
    def repairs(self) -> int:
        """How often on the way to `belief` a covariance had to be made definite again."""
        return self._timeline.head.repairs

    @property
    def contradicting(self) -> list[str]:
        """The sensors that are rejected only because the others agree with the estimate."""
        needed = self._policy.recover_after
        records = zip(self._names, self._timeline.head.records)
        return [name for name, record in records if 0 < needed <= record.rejections]

    def predicted(self, time: int) -> Gaussian:
        """Return the belief at a ``time`` not before the newest stamp; nothing is kept."""
        head = self._timeline.head
        if head.time is None:
            return head.belief
        return self._predict(head, time, self._filter)[0]

    def add_input(self, time: int, u: Array, now: int | None = None) -> Outcome:
        """Take the input that is in effect from ``time`` on; of one stamp, the last one counts.

        A controller answers twice when two readings of one instant come one after the other.
        ``now`` is when it came, if stamps in the future are to be refused.
        """
        return self.add([Arrival(None, time, u)], now)[0][0]

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
        return self.add([Arrival(name, time, y, covariance)], now)[0]

    def add(
        self, arrivals: Iterable[Arrival], now: int | None = None
    ) -> list[tuple[Outcome, Correction | None]]:
        """Take readings and inputs that came together, at ``now``, as if one came after the other.

        Returns of each what `add_reading` does; an input has no correction.
        """
        found = [self._place(arrival, now) for arrival in arrivals]
        self._settle()
        return [each.fate if isinstance(each, Item) else (each, None) for each in found]

    def _place(self, arrival: Arrival, now: int | None) -> Item | Outcome:
        """Put what came in its place and return it; or count it, and return why it is refused."""
        found = self._checked(arrival, now)
        if isinstance(found, Item):
            refused = self._timeline.insert(found, self._window)
            if arrival.source is not None:
                refused = self._restarted_for(found, refused, now)
            if refused is None:
                return found
            found = refused
        if arrival.source is not None:
            self.counts[arrival.source][found] += 1
        return found

    def _checked(self, arrival: Arrival, now: int | None) -> Item | Outcome:
        """Return an item of what came, or what is wrong with it."""
        name, time, values, covariance = arrival
        sensor = None if name is None else self._sensors[name]
        if values.shape != (self._zero.shape if sensor is None else sensor.covariance.shape[:1]):
            return Outcome.WRONG_SIZE
        if not is_finite(values):
            return Outcome.NOT_FINITE
        if name is not None and covariance is not None:
            sensor = self._noisy(name, covariance)
            if sensor is None:
                return Outcome.BAD_COVARIANCE
        if now is not None and time - now > self._policy.future_tolerance * 1e9:
            return Outcome.FUTURE
        order = len(self._order) if name is None else self._order[name]
        return Item((time, order), values, sensor, self._filter)

    def _restarted_for(
        self, item: Item, refused: Outcome | None, now: int | None
    ) -> Outcome | None:
        """Restart with a reading if too many in a row were too old; return why it is refused.

        While other readings are up to date, it is the sensor that lags, not the clock that went
        back.
        """
        if refused is not Outcome.TOO_OLD:
            self._old_in_a_row, self._current_at = 0, now
            return refused
        self._old_in_a_row += 1
        needed, current = self._policy.restart_after, self._current_at
        if not 0 < needed <= self._old_in_a_row:
            return refused
        if now is not None and current is not None and 0 <= now - current < _OUTDATED:
            return refused
        self.restart()
        return self._timeline.insert(item, self._window)

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

    def _settle(self) -> None:
        """Take in what was put in its place; keep account of readings."""
        for item, before in self._timeline.settle(self._process):
            if item.outcome is not before:
                counts = self.counts[self._names[item.key[1]]]
                counts[item.fate[0]] += 1
                if before is not None:
                    counts[before] -= 1
        self._timeline.forget(self._window)

    def _predict(self, state: State, time: int, filter: Filter) -> tuple[Gaussian, int]:
        """Return the belief at ``time``, and how often it was repaired on the way there.

        It is the initial one if the old is worth nothing by then.
        """
        if state.time is None or time == state.time or state.u is None:
            return state.belief, 0
        if self._max_gap and time - state.time > self._max_gap:
            return self._initial, 0
        try:
            return _committed(filter.predict(state.belief, state.u, (time - state.time) * 1e-9))
        except np.linalg.LinAlgError:
            return self._initial, 0

    def _process(self, item: Item, state: State) -> State:
        """Bring ``state`` to the item's time and take the item in."""
        time, order = item.key
        belief, repairs = self._predict(state, time, item.filter)
        if belief is not self._initial:
            repairs += state.repairs
        if belief is self._initial and state.time not in (None, time) and not item.restarted:
            item.restarted = True
            self.restarts += 1
        if item.sensor is None:
            item.after = State(time, belief, item.value, state.records, repairs)
            return item.after
        records = state.records
        try:
            first = state.time is None and self._policy.from_reading
            start = taken_at_its_word(belief, item.value, item.sensor) if first else belief
            item.outcome, item.correction, records = self._gate(
                item.filter, start, item.value, item.sensor, item.key, records
            )
            if item.outcome.accepted:
                belief, repaired = _committed(item.correction.posterior)
                repairs += repaired
        except np.linalg.LinAlgError:
            item.outcome, item.correction = Outcome.INDEFINITE, None
            records = agreement.replaced(records, order, records[order].after(time, None))
        item.after = State(time, belief, state.u, records, repairs)
        return item.after


def _is_covariance(R: Array, size: int) -> bool:
    """Tell whether ``R`` is finite, symmetric and positive definite."""
    if R.shape != (size, size) or not is_finite(R):
        return False
    skew = np.abs(R - R.T).max()
    if skew and not np.allclose(R, R.T):
        return False
    return is_definite(R)


def _committed(belief: Gaussian) -> tuple[Gaussian, int]:
    """Return a belief that may be kept, finite and definite, and how often it was repaired.

    Raises
    ------
    numpy.linalg.LinAlgError
        If it is neither.
    """
    if not is_finite(belief.mean):
        raise np.linalg.LinAlgError('the estimate is not finite')
    _, P, repairs = cholesky(belief.covariance)
    return (Gaussian(belief.mean, P) if repairs else belief), repairs
