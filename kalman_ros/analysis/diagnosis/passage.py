# SPDX-License-Identifier: Apache-2.0
"""Record of the pass of an extended Kalman filter: the matrices of each step, and its misfit.

From it the responses of innovations to faults are computed; see `responses`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import log, pi
from typing import Any, NamedTuple, TypeVar

import numpy as np

from kalman_ros.compiled.recursions import Rows
from kalman_ros.core import Array
from kalman_ros.linear.single import whitening

T = TypeVar('T')
LOG_2_PI = log(2.0 * pi)
#: Normalised innovations beyond this are those of outliers.
_OUTLIER = 5.0


@dataclass(slots=True)
class Event:
    """A reading in a filter pass: the step that led to it, and its correction.

    Parameters
    ----------
    sensor, index
        Name of the sensor, and index of the reading in its record.
    time
        Stamp in seconds.
    F, Q, dt
        Transition matrix (n, n) from the previous event, its noise covariance (n, n), and its
        duration in seconds.
    x, P, u
        Prediction (n,), its covariance (n, n), and the input (m,) that led to it.
    H, R, K, S, innovation
        Jacobian of the sensor, covariance of its noise, gain, innovation covariance and
        innovation.
    white, log
        L^-1 (k, k) with S = L L', and log |2 pi S|.
    """

    sensor: str
    index: int
    time: float
    F: Array
    Q: Array
    dt: float
    x: Array
    P: Array
    u: Array
    H: Array
    R: Array
    K: Array
    S: Array
    innovation: Array
    white: Array
    log: float


class Later(Sequence[T]):
    """A sequence of a known length, made when it is first used."""

    def __init__(self, count: int, make: Callable[[], list[T]]) -> None:
        self._count, self._make = count, make

    @cached_property
    def _all(self) -> list[T]:
        return self._make()

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        return self._all[index]

    def __iter__(self) -> Iterator[T]:
        return iter(self._all)


class Terms(NamedTuple):
    """The terms of the misfit of a sensor's readings, sorted by index.

    Parameters
    ----------
    index
        Index of each reading in its record (E,).
    square, log
        e'e and log |2 pi S| (E,).
    k
        Numbers of a reading.
    """

    index: Any
    square: Array
    log: Array
    k: int


@dataclass(frozen=True)
class Passage:
    """The events of a filter pass, with whitened innovations e = L^-1 nu where S = L L'.

    A pass in C has a ``table``: a function that returns a field of all events, or of those of a
    sensor, as an array.
    """

    events: Sequence[Event]
    whitened: Sequence[Array]
    table: Callable[[str, str], Any] | None = None

    def series(self, field: str, sensor: str = '') -> Any:
        """Return a field of an `Event`, or 'whitened', of all events or of those of a sensor.

        It is empty (0,) for a sensor without an event.
        """
        if self.table is not None:
            return self.table(field, sensor)
        if sensor and not len(self.of(sensor)):
            return NOTHING
        if field == 'whitened':
            return np.array([self.whitened[i] for i in self.of(sensor).tolist()])
        events = self.events_of(sensor) if sensor else self.events
        return np.array([getattr(event, field) for event in events])

    @cached_property
    def names(self) -> list[str]:
        """Sensors of the pass, in the order of their first events."""
        return list(dict.fromkeys(self.series('sensor').tolist()))

    @cached_property
    def sizes(self) -> Array:
        """Numbers of each reading (E,)."""
        return self._of_all(lambda e: np.full(len(e), e.shape[1]), len)

    @cached_property
    def square(self) -> Array:
        """Squares e'e of all whitened innovations (E,)."""
        return self._of_all(lambda e: np.einsum('ei,ei->e', e, e), lambda e: float(e.dot(e)))

    def _of_all(self, batch: Callable[[Array], Array], single: Callable[[Array], float]) -> Array:
        """Return a function of each whitened innovation (E,)."""
        if self.table is None:
            return np.array([single(e) for e in self.whitened])
        values = np.zeros(len(self.events))
        for name in self.names:
            values[self.of(name)] = batch(self.series('whitened', name))
        return values

    @cached_property
    def corrections(self) -> Array:
        """How far each event moves the estimate, K nu (E, n)."""
        moved = np.zeros(self.series('x').shape)
        for name in self.names:
            K, nu = self.series('K', name), self.series('innovation', name)
            moved[self.of(name)] = np.einsum('eij,ej->ei', K, nu)
        return moved

    @property
    def misfit(self) -> float:
        """Misfit of the pass, the sum of e'e + log |2 pi S|, which is -2 log likelihood."""
        log_sizes = sum(float(self.series('log', name).sum()) for name in self.names)
        return float(self.square.sum()) + log_sizes

    @cached_property
    def mean_square(self) -> float:
        """Mean square of the whitened innovations, each up to 5 deviations; 1 is expected."""
        e = np.concatenate([np.zeros(0), *self.whitened])
        return float(np.mean(np.square(np.clip(e, -_OUTLIER, _OUTLIER)))) if len(e) else 1.0

    @cached_property
    def rows(self) -> Rows:
        """The readings in their order, with a row for each of their numbers."""
        F, sizes = self.series('F'), self.sizes.astype(np.int_)
        first = np.cumsum(sizes) - sizes
        count, most, n = int(sizes.sum()), int(sizes.max(initial=0)), F.shape[-1]
        H, K, white = np.zeros((count, n)), np.zeros((count, n)), np.zeros((count, most))
        innovation = np.zeros(count)
        for name in self.names:
            whitened = self.whitened_of(name)
            k = whitened.shape[1]
            at = _rows(first[self.of(name)], k)
            H[at] = self.series('H', name).reshape(-1, n)
            K[at] = self.series('K', name).swapaxes(1, 2).reshape(-1, n)
            white[at, :k] = self.series('white', name).reshape(-1, k)
            innovation[at] = whitened.ravel()
        return Rows(F, sizes, first, H, K, white, innovation)

    def rows_of(self, sensor: str) -> Any:
        """Return the rows of the numbers of a sensor."""
        of = self.of(sensor)
        return _rows(self.rows.first[of], int(self.rows.sizes[of[0]]))

    @cached_property
    def _indices(self) -> dict[str, Any]:
        sensor = self.series('sensor')
        return {name: np.flatnonzero(sensor == name) for name in self.names}

    @cached_property
    def _terms(self) -> dict[str, Terms]:
        return {name: self._terms_of(name) for name in self.names}

    def terms(self, sensor: str) -> Terms:
        """Return the terms of the misfit of a sensor's readings."""
        return self._terms.get(sensor, _NO_TERMS)

    def _terms_of(self, sensor: str) -> Terms:
        index, at = self.series('index', sensor), self.of(sensor)
        order = np.argsort(index, kind='stable')
        log_sizes = self.series('log', sensor)[order]
        return Terms(index[order], self.square[at][order], log_sizes, int(self.sizes[at[0]]))

    def first(self, count: int) -> Passage:
        """Return the first events."""
        if self.table is None:
            return Passage(self.events[:count], self.whitened[:count])
        whole, events, whitened = self.table, self.events, self.whitened
        counts = {name: int(np.searchsorted(self.of(name), count)) for name in self.names}

        def table(field: str, sensor: str) -> Any:
            return whole(field, sensor)[: counts.get(sensor, 0) if sensor else count]

        count = min(count, len(events))
        return Passage(
            Later(count, lambda: [*events[:count]]),
            Later(count, lambda: [*whitened[:count]]),
            table,
        )

    def until(self, time: float) -> Passage:
        """Return the events up to a time (s)."""
        return self.first(int(np.searchsorted(self.series('time'), time, 'right')))

    def selected(self, sensor: str, rows: Any) -> Passage:
        """Return the pass over a record that is reduced to ``rows``, in this order.

        The rows must contain all events of the sensor.
        """
        index = {row: i for i, row in enumerate(rows.tolist())}
        events = [
            replace(event, index=index[event.index]) if event.sensor == sensor else event
            for event in self.events
        ]
        return Passage(events, self.whitened)

    def of(self, sensor: str) -> Any:
        """Return the indices of the events of a sensor."""
        return self._indices.get(sensor, np.zeros(0, dtype=int))

    def events_of(self, sensor: str) -> list[Event]:
        """Return the events of a sensor."""
        return [self.events[i] for i in self.of(sensor).tolist()]

    def whitened_of(self, sensor: str) -> Array:
        """Return the whitened innovations of a sensor (E, k)."""
        return np.asarray(self.series('whitened', sensor))

    def squares(self, sensor: str) -> Array:
        """Return the squares e'e of the whitened innovations of a sensor (E,)."""
        return np.asarray(self.square[self.of(sensor)])


def _rows(first: Any, k: int) -> Any:
    """Return k rows from each of the first ones on."""
    return (first[:, None] + np.arange(k)).ravel()


#: Fields and terms of a sensor without an event.
NOTHING = np.zeros(0, dtype=int)
_NO_TERMS = Terms(NOTHING, np.zeros(0), np.zeros(0), 0)


def whitener(S: Array) -> tuple[Array, float]:
    """Return L^-1 (k, k) with S = L L', and log |2 pi S|.

    Raises
    ------
    numpy.linalg.LinAlgError
        If S is not positive definite.
    """
    if len(S) == 1 and S[0, 0] > 0.0:
        return S**-0.5, LOG_2_PI + log(S[0, 0])
    white = whitening(S)
    return white, len(S) * LOG_2_PI - 2.0 * sum(map(log, white.diagonal().tolist()))


def explained_in_both(before: Passage, after: Passage) -> float:
    """Return the reduction of the misfit of the readings that are in both passes."""
    return sum(_change(before.terms(name), after.terms(name))[0] for name in before.names)


def explained(before: Passage, after: Passage) -> float:
    """Return the reduction of the misfit by a correction.

    A reading that the correction omits counts by the excess of its misfit over the expectation.
    """
    gain = 0.0
    for name in before.names:
        old = before.terms(name)
        change, omitted = _change(old, after.terms(name))
        gain += change + float(np.sum(old.square[omitted] - old.k - DROPPED))
    return gain


def in_both(old: Terms, new: Terms) -> tuple[Any, Any]:
    """Return which readings of each of two passes the other one has, too."""
    return np.isin(old.index, new.index), np.isin(new.index, old.index)


def _change(old: Terms, new: Terms) -> tuple[float, Any]:
    """Return the reduction of the misfit of the readings in both, and which of the old are not."""
    in_new, in_old = in_both(old, new)
    change = (old.square + old.log)[in_new] - (new.square + new.log)[in_old]
    return float(change.sum()), ~in_new


#: Cost of the omission of a reading in -2 log likelihood, as of a reading at about 3 sigma.
DROPPED = 10.0
