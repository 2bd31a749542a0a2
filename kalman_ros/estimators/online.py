# SPDX-License-Identifier: Apache-2.0
"""The online estimator: a filter with time order, late data, inputs, gates and outcome counts.

Nodes, replays and Monte Carlo studies share this class. Times are whole nanoseconds, like ROS
stamps, so differences are exact.

The estimator keeps the items of a window ordered by stamp, with the belief after each. A late
item is inserted and the items after it are processed again with the same operations, so the
result does not depend on the order of arrival. Items that arrive together are all inserted
before processing, so the later ones are repeated only once. A model in discrete time has a
state only at its steps: stamps are moved to the nearest step.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, is_finite
from kalman_ros.core.discrete_model import MOST_PERIODS
from kalman_ros.linear.single import is_definite

from . import agreement
from .arrivals import Arrivals, Schedule, Taken
from .diffuse import Diffuse, begun
from .filter import Correction, Filter, committed
from .gate import Gate
from .outcome import Outcome
from .policy import Policy
from .start import likeliest, match_reading, rested
from .timeline import Arrival, Item, State, Timeline

#: Old readings mean that the clock went back only if no reading was current for this long, in
#: nanoseconds.
_OUTDATED = 250_000_000
#: Fewest arrivals that are processed at once: below, one after the other is as fast.
_TOGETHER = 8


class OnlineEstimator:
    """A `Filter` on stamped readings and inputs, in any order of arrival.

    Parameters
    ----------
    filter
        Filter, which knows time only as step lengths.
    sensors
        Sensors by name, in the order in which readings with one stamp are fused.
    initial
        Belief at the first stamp received, and after each restart.
    input
        Input (m,) in effect until the first one arrives.
    policy
        Treatment of late, doubtful or missing data.
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
        #: Called with the items that no later item can change, in the order of their stamps.
        self.on_final: Callable[[Sequence[Item]], object] = len
        #: Called after the items before a reset are final.
        self.on_reset: Callable[[], object] = lambda: None
        self._timeline = Timeline(State(None, initial, None, ()))
        self.configure(filter, sensors, policy or Policy())
        self.reset(initial)

    def configure(self, filter: Filter, sensors: Mapping[str, Sensor], policy: Policy) -> None:
        """Replace the filter, the sensors (same names) and the policy."""
        self._filter = filter
        model = filter.model
        self._period = model.period * 1e9 if model.is_discrete else 0.0
        self._sensors = dict(sensors)
        self._policy = policy
        self._window = round(policy.window * 1e9)
        self._max_gap = round(policy.max_gap * 1e9)
        self._gate = Gate({name: sensors[name] for name in self._order}, policy)
        self._with_covariance: dict[str, tuple[bytes, Sensor]] = {}

    def reset(self, belief: Gaussian) -> None:
        """Drop all items; the belief holds at the next stamp received. Counts continue."""
        belief = begun(belief)
        self._initial = belief
        self.finish()
        self.on_reset()
        first = None if self._policy.rest_until_input else self._zero
        records = (agreement.Record(),) * len(self._order)
        self._timeline = Timeline(State(None, belief, first, records))
        self._old_in_a_row = 0
        #: The first stamp, from which the steps of a model in discrete time are counted.
        self._first: int | None = None
        #: Time of arrival of the last reading that was not too old, in nanoseconds.
        self._current_at: int | None = None

    def finish(self) -> None:
        """Make all items final, including those within the window."""
        self.on_final(self._timeline.drain())

    def restart(self) -> None:
        """Drop all items because the clock went back, and count the restart."""
        self._settle()
        self.restarts += 1
        self.reset(self._initial)

    @property
    def filter(self) -> Filter:
        """The filter in use."""
        return self._filter

    @property
    def sensors(self) -> Mapping[str, Sensor]:
        """The sensors in use, by name."""
        return self._sensors

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
        """The number of covariances repaired on the way to `belief`."""
        return self._timeline.head.repairs

    @property
    def noise(self) -> dict[str, float]:
        """The factor of the covariance of its noise, by sensor whose noise is adapted."""
        records = zip(self._names, self._timeline.head.records)
        return {n: record.noise for n, record in records if n in self._policy.adaptive}

    @property
    def contradicting(self) -> list[str]:
        """The sensors rejected only because the others agree with the estimate."""
        needed = self._policy.recover_after
        records = zip(self._names, self._timeline.head.records)
        return [name for name, record in records if 0 < needed <= record.rejections]

    def predicted(self, time: int, ending: tuple[int, Array] | None = None) -> Gaussian:
        """Return the belief at a ``time`` not before the newest stamp; nothing is kept.

        With ``ending``, the input ends at that time, and this one is in effect from then on.
        """
        head, time = self._timeline.head, self.nearest(time)
        time = max(time, head.time or time)
        if ending is not None and head.time is not None and head.u is not None:
            end = min(max(self.nearest(ending[0]), head.time), time)
            if not self._max_gap or time - head.time <= self._max_gap:
                head = State(end, self._predict(head, end, self._filter)[0], ending[1], ())
        return self._predict(head, time, self._filter)[0]

    def add_input(self, time: int, u: Array, now: int | None = None) -> Outcome:
        """Add the input in effect from ``time`` on; of equal stamps the last input counts.

        A controller answers twice when two readings of one instant are received separately.
        With ``now``, the time of arrival, stamps in the future are refused.
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
        """Add a reading of the sensor ``name``, with the covariance of its message if it has one.

        Returns the outcome, and the correction if one was computed (also when the gate rejected
        it). With ``now``, the time of arrival, stamps in the future are refused.
        """
        return self.add([Arrival(name, time, y, covariance)], now)[0]

    def add(
        self, arrivals: Iterable[Arrival], now: int | None = None
    ) -> list[tuple[Outcome, Correction | None]]:
        """Add readings and inputs that arrived together at ``now``, as if in sequence.

        Returns the result of `add_reading` for each; an input has no correction.
        """
        results = [self._place(arrival, now) for arrival in arrivals]
        self._settle()
        return [result.fate if isinstance(result, Item) else (result, None) for result in results]

    @property
    def takes_many(self) -> bool:
        """Whether `add_first` may ever add more than none."""
        decides = self._policy.from_rest or self._policy.adaptive or self._period
        return not decides and self.on_final is len and self._filter.has_first_steps

    def add_first(self, arrivals: Arrivals) -> Taken | None:
        """Add those of many arrivals that need no decision at once, as `add` one after the other.

        Those are the first ones, up to one that is refused, doubted, follows a gap or leaves a
        covariance to repair. Returns their results; None if there are too few, or if the
        filter does not compute their steps at once.
        """
        head, last = self._timeline.head, self._timeline.last
        if last is None or head.u is None or isinstance(head.belief, Diffuse):
            return None
        ahead = self._policy.future_tolerance * 1e9
        arrivals = arrivals.some(slice(arrivals.usable(ahead) if self.takes_many else 0))
        if len(arrivals.time) < _TOGETHER:
            return None
        schedule = Schedule(arrivals, last, self._window, self._max_gap)
        if len(schedule) < _TOGETHER:
            return None
        data, sensors = schedule.data(head.u), [self._sensors[name] for name in self._names]
        steps = self._filter.first_steps(head.belief, data, sensors, self._gate.agreeing)
        if steps is None:
            return None
        taken = schedule.taken(steps)
        count = len(taken.time)
        if not count:
            return taken
        items = list(schedule.items(count, steps, self._window, head, self._filter, sensors))
        self._timeline.extend(items, whole=len(items) == count)
        self._timeline.forget(self._window)
        for name, readings in zip(self._names, taken.nis):
            if len(readings):
                self.counts[name][Outcome.FUSED] += len(readings)
        read = np.flatnonzero(arrivals.source[:count] < len(self._names))
        if len(read):
            self._old_in_a_row, self._current_at = 0, int(arrivals.now[read[-1]])
        return taken

    def _place(self, arrival: Arrival, now: int | None) -> Item | Outcome:
        """Insert an arrival and return its item, or count and return its refusal."""
        result = self._checked(arrival, now)
        if isinstance(result, Item):
            refused = self._timeline.insert(result, self._window)
            if refused is Outcome.TOO_OLD and arrival.source is not None:
                refused = self._restarted_for(result, now)
            elif arrival.source is not None:
                self._old_in_a_row, self._current_at = 0, now
            if refused is None:
                return result
            result = refused
        if arrival.source is not None:
            self.counts[arrival.source][result] += 1
        return result

    def _checked(self, arrival: Arrival, now: int | None) -> Item | Outcome:
        """Return an item for an arrival, or the outcome if the arrival is invalid."""
        name, time, values = arrival.source, arrival.time, arrival.values
        sensor = None if name is None else self._sensors[name]
        if values.shape != (self._zero.shape if sensor is None else sensor.covariance.shape[:1]):
            return Outcome.WRONG_SIZE
        if not is_finite(values):
            return Outcome.NOT_FINITE
        if name is not None and arrival.covariance is not None:
            sensor = self._with_noise(name, arrival.covariance)
            if sensor is None:
                return Outcome.BAD_COVARIANCE
        if now is not None and time - now > self._policy.future_tolerance * 1e9:
            return Outcome.FUTURE
        order = len(self._order) if name is None else self._order[name]
        if self._first is None:
            self._first = time
        step = self.nearest(time) if self._period else time
        return Item((step, order, time), values, sensor, self._filter)

    def _restarted_for(self, item: Item, now: int | None) -> Outcome | None:
        """Restart if too many readings in a row were too old; return the outcome if refused.

        While other readings are current, the sensor lags and the clock did not go back.
        """
        self._old_in_a_row += 1
        needed, current = self._policy.restart_after, self._current_at
        if not 0 < needed <= self._old_in_a_row:
            return Outcome.TOO_OLD
        if now is not None and current is not None and 0 <= now - current < _OUTDATED:
            return Outcome.TOO_OLD
        self.restart()
        _, order, stamp = item.key
        self._first, item.key = stamp, (stamp, order, stamp)
        return self._timeline.insert(item, self._window)

    def _with_noise(self, name: str, covariance: Array) -> Sensor | None:
        """Return the sensor with this noise, None if it is no covariance; cache the last one."""
        key = covariance.tobytes()
        last = self._with_covariance.get(name)
        if last is not None and last[0] == key:
            return last[1]
        sensor = self._sensors[name]
        if not is_covariance(covariance, len(sensor.covariance)):
            return None
        sensor = sensor.with_covariance(covariance)
        self._with_covariance[name] = (key, sensor)
        return sensor

    def _settle(self) -> None:
        """Process the inserted items and count outcomes."""
        for item, before in self._timeline.settle(self._process):
            if item.outcome is not before:
                counts = self.counts[self._names[item.key[1]]]
                counts[item.fate[0]] += 1
                if before is not None:
                    counts[before] -= 1
        self.on_final(self._timeline.forget(self._window))

    def nearest(self, time: int) -> int:
        """Return the time of the nearest step of a model in discrete time, in nanoseconds.

        Its steps are whole periods before and after the first stamp. A period need not be a whole
        number of nanoseconds.
        """
        period, first = self._period, self._first or 0
        return first + round(round((time - first) / period) * period) if period else time

    def _predict(self, state: State, time: int, filter: Filter) -> tuple[Gaussian, int]:
        """Return the belief at ``time``, and the number of repairs on the way.

        The belief is the initial one if the previous one has expired.
        """
        if state.time is None or time == state.time or state.u is None:
            return state.belief, 0
        gap = time - state.time
        if (self._max_gap and gap > self._max_gap) or gap > MOST_PERIODS * (self._period or gap):
            return self._initial, 0
        try:
            return committed(filter.predict(state.belief, state.u, (time - state.time) * 1e-9))
        except np.linalg.LinAlgError:
            return self._initial, 0

    def _process(self, item: Item, state: State) -> State:
        """Predict ``state`` to the item's time and apply the item."""
        time, order, _ = item.key
        belief, repairs = self._predict(state, time, item.filter)
        if belief is not self._initial:
            repairs += state.repairs
        expired = belief is self._initial and state.time not in (None, time)
        if expired:
            state = state._replace(records=agreement.with_declared_noise(state.records))
        if expired != item.restarted:  # a late item may close the gap before this one
            item.restarted = expired
            self.restarts += 1 if expired else -1
        if item.sensor is None:
            if (state.u is None or state.u is self._zero) and self._rests(belief, item):
                with suppress(np.linalg.LinAlgError):
                    belief, more = committed(rested(belief, item.value, item.filter.model))
                    repairs += more
            item.after = State(time, belief, item.value, state.records, repairs)
            return item.after
        records = state.records
        try:
            start = self._started(belief, item, state)
            item.outcome, item.correction, records = self._gate.correct(
                item.filter, start, item.value, item.sensor, (time, order), records
            )
            if item.outcome.accepted:
                belief, repaired = committed(item.correction.posterior)
                repairs += repaired
        except np.linalg.LinAlgError:
            item.outcome, item.correction = Outcome.INDEFINITE, None
            records = agreement.replaced(records, order, records[order].after(time, None))
        item.after = State(time, belief, state.u, records, repairs)
        return item.after

    def _started(self, belief: Gaussian, item: Item, state: State) -> Gaussian:
        """Return the belief with its mean moved by a first reading, if it starts from that."""
        assert item.sensor is not None
        if state.records[item.key[1]].time is None and self._rests(belief, item):
            posterior = likeliest(belief, item.value, item.sensor, item.filter.model)
            return belief._replace(mean=posterior.mean)
        if self._policy.from_reading and state.time is None and not isinstance(belief, Diffuse):
            return match_reading(belief, item.value, item.sensor)
        return belief

    def _rests(self, belief: Gaussian, item: Item) -> bool:
        """Return whether a belief starts at rest: one that the first items may move."""
        fixed = item.filter.fixed_gain or item.filter.mixture
        return self._policy.from_rest and not fixed and not isinstance(belief, Diffuse)


def is_covariance(R: Array, size: int) -> bool:
    """Return whether ``R`` is finite, symmetric and positive definite."""
    if R.shape != (size, size) or not is_finite(R):
        return False
    skew = np.abs(R - R.T).max()
    if skew and not np.allclose(R, R.T):
        return False
    return is_definite(R)
