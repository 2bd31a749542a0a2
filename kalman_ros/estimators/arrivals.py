# SPDX-License-Identifier: Apache-2.0
"""Many arrivals at once: those of a recording, which are known before they are processed."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, unchecked
from kalman_ros.core.ordered_data import FirstSteps, OrderedData

from . import agreement
from .filter import Correction, Filter
from .outcome import Outcome
from .timeline import Item, State

#: Most steps for each arrival, on average: one that is late repeats those behind it.
_STEPS = 8
#: Numbers of this size are left to a look at each of them: their squares are infinite.
_HUGE = 1e150


class Arrivals(NamedTuple):
    """Readings and inputs in the order in which they were received.

    Parameters
    ----------
    time, now
        Stamps and times of arrival (S,), in nanoseconds.
    source
        Index of the sensor (S,); the number of sensors for an input.
    row
        Index of the reading among those of its sensor (S,), or of the input.
    values
        Readings (N, k) of each sensor, and behind these the inputs (N, m).
    covariances
        Covariances (N, k, k) of the readings of each sensor.
    """

    time: Any
    now: Any
    source: Any
    row: Any
    values: Sequence[Array]
    covariances: Sequence[Array]

    def some(self, which: slice) -> Arrivals:
        """Return some of the arrivals, one behind the other."""
        time, now, source, row = (column[which] for column in self[:4])
        return Arrivals(time, now, source, row, self.values, self.covariances)

    def usable(self, ahead: float) -> int:
        """Return the number of arrivals before the first that needs a closer look.

        Such are numbers of no usual size, stamps later than the arrival by more than ``ahead`` ns,
        and times of arrival of 0, which are unknown.
        """
        bad: Any = (self.time - self.now > ahead) | (self.now == 0)
        for index, values in enumerate(self.values):
            read = np.flatnonzero(self.source == index)
            bad[read] |= ~(np.abs(values[self.row[read]]) < _HUGE).all(axis=1)
        return int(np.argmax(np.append(bad, True)))

    def follow_each_other(self, last: tuple[int, int], longest: int) -> bool:
        """Return whether each is later than all before it, by at most ``longest`` unless it is 0.

        ``last`` is the stamp and the source of the newest item before them.
        """
        gap = np.diff(self.time, prepend=last[0])
        later = (gap > 0) | ((gap == 0) & (np.diff(self.source, prepend=last[1]) > 0))
        return bool(later.all() and not (longest and (gap > longest).any()))


class _Steps(NamedTuple):
    """Steps of a filter through arrivals.

    Parameters
    ----------
    start
        Index of the step behind which each step begins (S,); -1 for the belief before all.
    length
        Length of each step in nanoseconds.
    input
        Row of the input that acts in each step, plus 1; 0 for the input before all.
    arrival
        Index of the arrival that each step leads to.
    first, last, newest
        First and last step for each arrival (A,), and the newest stamp known after it.
    """

    start: Any
    length: Any
    input: Any
    arrival: Any
    first: Any
    last: Any
    newest: Any


class Schedule:
    """The steps of a filter through arrivals in the order of receipt.

    Of an arrival that is late, the step is from the belief before it, and those of the arrivals
    behind it follow once more, as an `OnlineEstimator` does.

    Parameters
    ----------
    arrivals
        Arrivals, all of which are `usable`.
    last
        Stamp and source of the newest item before them.
    window, longest
        How late an arrival may be, and the longest gap between two, 0 for any, in nanoseconds.
    """

    def __init__(
        self, arrivals: Arrivals, last: tuple[int, int], window: int, longest: int
    ) -> None:
        self.arrivals = arrivals
        self._in_order = arrivals.follow_each_other(last, longest)
        self._steps = (
            _one_each(arrivals, last) if self._in_order else _all(arrivals, last, window, longest)
        )
        self._sources = arrivals.source[self._steps.arrival]
        #: Place of each step among the steps to readings of the same sensor.
        self._rank = np.zeros(len(self._sources), dtype=int)
        for index in range(len(arrivals.values)):
            of_source = self._sources == index
            self._rank[of_source] = np.arange(np.count_nonzero(of_source))

    def __len__(self) -> int:
        return len(self._steps.last)

    def data(self, u: Array) -> OrderedData:
        """Return the data of the steps, where ``u`` (m,) acts at first."""
        arrivals, of, source = self.arrivals, self._steps.arrival, self._sources
        return OrderedData(
            arrivals.time[of] * 1e-9,
            1e-9 * self._steps.length,
            np.vstack((u, arrivals.values[-1])),
            self._steps.input,
            np.where(source == len(arrivals.covariances), -1, source),
            arrivals.row[of],
            arrivals.values[:-1],
            arrivals.covariances,
            self._steps.start,
        )

    def taken(self, steps: FirstSteps) -> Taken:
        """Return the results for those arrivals all steps of which were made."""
        count = int(np.searchsorted(self._steps.last, len(steps.mean)))
        newest = self._steps.newest[:count]
        if self._in_order:
            return Taken(newest, *steps)
        first, last = self._steps.first[:count], self._steps.last[:count]
        source = self.arrivals.source[:count]
        read = [self._rank[first[source == index]] for index in range(len(steps.nis))]
        return Taken(
            newest,
            steps.mean[last],
            steps.covariance[last],
            *(
                [values[at] for values, at in zip(column, read)]
                for column in (steps.innovation, steps.S, steps.nis)
            ),
        )

    def items(
        self,
        count: int,
        steps: FirstSteps,
        window: int,
        head: State,
        filter: Filter,
        sensors: Sequence[Sensor],
    ) -> Iterator[Item]:
        """Yield the items within a window after ``count`` arrivals, and the one before these.

        Parameters
        ----------
        count
            Number of arrivals.
        steps
            Beliefs after the steps, and the innovations.
        window
            Length of the window in nanoseconds.
        head
            State before all arrivals.
        filter, sensors
            Filter, and the sensors in their order.
        """
        arrivals = self.arrivals.some(slice(count))
        acts, made = len(arrivals.covariances), int(self._steps.last[count - 1]) + 1
        order = np.lexsort((arrivals.source, arrivals.time))
        final = np.zeros(count, dtype=int)
        final[self._steps.arrival[:made]] = np.arange(made)
        newest = arrivals.time[order[-1]]
        begin = max(int(np.searchsorted(arrivals.time[order], newest - window)) - 1, 0)
        records, kept = _records(arrivals, order[:begin], head.records), order[begin:]
        which = final[kept]
        means, covariances = steps.mean[which], steps.covariance[which]
        indices = (which, arrivals.time[kept], arrivals.source[kept], arrivals.row[kept])
        kept_items = zip(means, covariances, *(index.tolist() for index in indices))
        usual = [
            (sensor.covariance == R).all(axis=(1, 2))
            for R, sensor in zip(arrivals.covariances, sensors)
        ]
        for mean, covariance, step, time, source, row in kept_items:
            belief = unchecked((mean, covariance))
            value, acting = arrivals.values[source][row], self._steps.input[step]
            u = arrivals.values[-1][acting - 1] if acting else head.u
            if source == acts:
                item, u = Item((time, source, time), value, None, filter), value
            else:
                sensor = sensors[source]
                if not usual[source][row]:
                    sensor = sensor.with_covariance(arrivals.covariances[source][row])
                item = Item((time, source, time), value, sensor, filter)
                item.outcome = Outcome.FUSED
                item.correction = _correction(belief, steps, source, int(self._rank[step]))
                record = records[source].after(time, True)._replace(noise=1.0)
                records = agreement.replaced(records, source, record)
            item.after = State(time, belief, u, records, head.repairs)
            yield item


def _one_each(arrivals: Arrivals, last: tuple[int, int]) -> _Steps:
    """Return a step for each of the arrivals, which follow each other."""
    step = np.arange(len(arrivals.time))
    acts = np.where(arrivals.source == len(arrivals.covariances), step, -1)
    acting = np.append(-1, np.maximum.accumulate(acts)[:-1])
    input = np.where(acting < 0, 0, arrivals.row[acting] + 1)
    length = np.diff(arrivals.time, prepend=last[0])
    return _Steps(step - 1, length, input, step, step, step, arrivals.time)


def _all(arrivals: Arrivals, last: tuple[int, int], window: int, longest: int) -> _Steps:
    """Return the steps for arrivals, with those that follow once more behind one that is late.

    They end before an arrival that is refused or follows a gap, and where they become too many.
    """
    times, sources = arrivals.time.tolist(), arrivals.source.tolist()
    rows, acts = arrivals.row.tolist(), len(arrivals.covariances)
    keys = [last]
    # for each key: the arrival, its last step, and the input that acts from there on
    items = [(-1, -1, 0)]
    most = _STEPS * len(times)
    columns: list[list[int]] = [[] for _ in _Steps._fields]
    start, length, input, arrival, first, final, newest = columns
    for index, key in enumerate(zip(times, sources)):
        place, begun = len(keys), len(start)
        if key <= keys[-1]:
            place = bisect_left(keys, key)
            if key[0] < keys[-1][0] - window or not place or keys[place] == key:
                break
        keys.insert(place, key)
        items.insert(place, (index, -1, 0))
        _, before, acting = items[place - 1]
        for at in range(place, len(keys)):
            which = items[at][0]
            step = len(start)
            start.append(before)
            length.append(keys[at][0] - keys[at - 1][0])
            input.append(acting)
            arrival.append(which)
            if keys[at][1] == acts:
                acting = rows[which] + 1
            items[at] = which, step, acting
            before = step
        if (longest and max(length[begun:]) > longest) or len(start) > most:
            del start[begun:], length[begun:], input[begun:], arrival[begun:]
            break
        first.append(begun)
        final.append(before)
        newest.append(keys[-1][0])
    return _Steps(*(np.array(column, dtype=np.int64) for column in columns))


class Taken(NamedTuple):
    """Results for the first of many arrivals, all of which were fused.

    Parameters
    ----------
    time, mean, covariance
        Newest stamp (S,) in nanoseconds after each arrival, and the belief then.
    innovation, S, nis
        Innovations (N, k) of the readings of each sensor, their covariances (N, k, k), and their
        normalised squares (N,).
    """

    time: Any
    mean: Array
    covariance: Array
    innovation: Sequence[Array]
    S: Sequence[Array]
    nis: Sequence[Array]


def _records(arrivals: Arrivals, which: Any, records: agreement.Records) -> agreement.Records:
    """Return the records after some arrivals in the order of their stamps, which agree."""
    time, source = arrivals.time[which], arrivals.source[which]
    after = []
    for index, record in enumerate(records):
        stamps = time[source == index][-2:].tolist()
        for stamp in stamps:
            record = record.after(stamp, True)
        after.append(record._replace(noise=1.0) if stamps else record)
    return tuple(after)


def _correction(belief: Gaussian, steps: FirstSteps, source: int, rank: int) -> Correction:
    nis = float(steps.nis[source][rank])
    return Correction(belief, steps.innovation[source][rank], steps.S[source][rank], nis=nis)
