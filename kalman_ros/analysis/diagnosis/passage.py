# SPDX-License-Identifier: Apache-2.0
"""Pass of an extended Kalman filter in the order of stamps, with the matrices of each step.

A replay has the results of the online estimator, which processes readings as they are received. A
pass has the results of a filter that processes the readings in order, and its linearisation, from
which the responses of innovations to faults are computed; see `responses`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isnan, log, nan, pi
from typing import Any, NamedTuple, TypeVar

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array, Gaussian, is_finite
from kalman_ros.core.ordered_data import OrderedData, StepMatrices
from kalman_ros.estimators import filter_class
from kalman_ros.estimators.diffuse import Diffuse
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.plan import parts
from kalman_ros.linear.matrices import identity
from kalman_ros.linear.single import sandwich, scaled, whitening
from kalman_ros.simulation.computed import computed

from .beginning import likeliest
from .evidence import Evidence

T = TypeVar('T')
LOG_2_PI = log(2.0 * pi)
#: Normalised innovations are limited to this magnitude.
_FAR = 1e6
#: Normalised innovations beyond this are those of outliers.
_OUTLIER = 5.0
#: Normalised squares are limited to this value for the choice of an initial belief, since larger
#: squares are those of outliers.
_OUTLYING = 30.0


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


class _Later(Sequence[T]):
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
            return _NOTHING
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
        found = np.zeros(len(self.events))
        for name in self.names:
            found[self.of(name)] = batch(self.series('whitened', name))
        return found

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
        own = {name: int(np.searchsorted(self.of(name), count)) for name in self.names}

        def table(field: str, sensor: str) -> Any:
            return whole(field, sensor)[: own.get(sensor, 0) if sensor else count]

        count = min(count, len(events))
        return Passage(
            _Later(count, lambda: [*events[:count]]),
            _Later(count, lambda: [*whitened[:count]]),
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


#: Fields and terms of a sensor without an event.
_NOTHING = np.zeros(0, dtype=int)
_NO_TERMS = Terms(_NOTHING, np.zeros(0), np.zeros(0), 0)


def passage(evidence: Evidence, until: float = inf, strict: bool = True) -> Passage:
    """Run an extended Kalman filter over the usable readings, up to a stamp (s).

    Duplicates and readings that are not `usable` are omitted.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the filter fails and the pass is ``strict``; otherwise the pass ends there.
    """
    data = _ordered(evidence, until)
    return _run_filter(data, _initial_belief(data, until), strict=strict)[0]


def _initial_belief(data: _Readings, until: float) -> Gaussian:
    """Return the belief from which one filter can follow the readings, or the likeliest part.

    A pass over the first seconds starts at the whole belief, since such passes are many, and too
    short to choose a part.
    """
    scenario = data.evidence.scenario
    if not filter_class(scenario.filter).mixture or until < inf:
        return scenario.initial_belief

    def follow(part: Gaussian) -> Iterator[float]:
        for _, fused in _steps(data, part):
            assert fused is not None  # there is no gate
            event, e = fused
            yield min(float(e.dot(e)), _OUTLYING) + event.log

    return likeliest(scenario.initial_belief, scenario.model.state, follow)


@dataclass(frozen=True)
class _Readings:
    """The readings of a recording, with the sensors' names and the indices in their records.

    Parameters
    ----------
    evidence
        Recording.
    names, indices
        The sensors of ``data``, and for each of their readings its index in the record.
    data
        Inputs and readings in order.
    """

    evidence: Evidence
    names: list[str]
    indices: list[Any]
    data: OrderedData

    def limits(self, gate: tuple[str, float] | None) -> list[float]:
        """Return the largest NIS of each sensor, with a ``gate`` (sensor, largest NIS)."""
        name, limit = gate or ('', inf)
        return [limit if each == name else inf for each in self.names]


def _ordered(evidence: Evidence, until: float = inf) -> _Readings:
    """Return the usable readings in the order of stamps, and of sensors for equal stamps.

    An input acts from its stamp on, behind the readings of that time.
    """
    names, indices, times, orders = [], [], [], []
    for name in evidence.scenario.enabled:
        record = evidence.sensors.get(name)
        if record is None or not len(record):
            continue
        rows = np.flatnonzero(usable(record) & (record.stamp <= until))
        stamps, first = np.unique(np.round(record.stamp[rows], 9), return_index=True)
        names.append(name)
        indices.append(rows[first])
        times.append(stamps)
        orders.append(np.arange(len(stamps)))
    inputs = evidence.inputs
    acts = np.argsort(inputs.stamp, kind='stable')
    stamps = np.round(inputs.stamp[acts], 9)
    last = max((float(each[-1]) for each in times if len(each)), default=-inf)
    acts, stamps = acts[stamps < last], stamps[stamps < last]
    sensor = np.repeat([*range(len(names)), -1], [*map(len, times), len(stamps)])
    row = np.concatenate((*orders, np.full(len(stamps), -1))).astype(int)
    time = np.concatenate((*times, stamps))
    order = np.lexsort((sensor, sensor < 0, time))
    time, sensor, row = time[order], sensor[order], row[order]
    begun = np.cumsum(sensor < 0)
    dt = np.rint(np.diff(time, prepend=time[:1]) * 1e9) / 1e9  # equal steps, equal durations
    if evidence.parameters.get('rest_until_input') and len(inputs.stamp):
        dt[begun - (sensor < 0) == 0] = 0.0
    data = OrderedData(
        time,
        dt,
        np.vstack((np.zeros(evidence.scenario.model.input.size), inputs.value[acts])),
        begun - (sensor < 0),
        sensor,
        row,
        [evidence.sensors[name].value[rows] for name, rows in zip(names, indices)],
        [evidence.sensors[name].covariance[rows] for name, rows in zip(names, indices)],
    )
    return _Readings(evidence, names, indices, data)


def _run_filter(
    given: _Readings, first: Gaussian, gate: tuple[str, float] | None = None, *, strict: bool
) -> tuple[Passage, float]:
    """Return a pass from the ``first`` belief, and the time until which readings were processed.

    That is inf unless the filter fails and the pass is not ``strict``. A ``gate`` (sensor, largest
    NIS) omits the readings beyond it.
    """
    at_once = _matrices(given, first, gate)
    if at_once is not None:
        return _Table(given, at_once).passage, inf
    found, last = list[tuple[Event, Array]](), -inf
    try:
        for time, fused in _steps(given, first, gate):
            last = time
            if fused is not None:
                found.append(fused)
        last = inf
    except np.linalg.LinAlgError:
        if strict:
            raise
    return Passage([event for event, _ in found], [e for _, e in found]), last


def _matrices(
    given: _Readings, first: Gaussian, gate: tuple[str, float] | None
) -> StepMatrices | None:
    """Return the matrices of a pass in C; None where it needs a step after the other."""
    if isinstance(first, Diffuse):
        return None
    scenario, data = computed(given.evidence.scenario), given.data
    lengths, which = np.unique(data.dt, return_inverse=True)
    counts = np.array([parts(scenario.model, dt) for dt in lengths.tolist()], dtype=int)
    sensors = [scenario.sensors[name].sensor for name in given.names]
    limits = given.limits(gate)
    return scenario.model.filter_pass((*first,), data, counts[which], sensors, limits)


class _Table:
    """The events of a pass in C, by their fields."""

    def __init__(self, given: _Readings, found: StepMatrices) -> None:
        data, at = given.data, np.flatnonzero(found.fused)
        self._sensor, row, time = data.sensor[at], data.row[at], data.time[at]
        names = [*given.names, '']  # a pass without a reading has names, too
        self._whole = {
            'sensor': np.array(names)[self._sensor], 'time': time, 'F': found.F, 'Q': found.Q,
            'dt': np.diff(time, prepend=time[:1]), 'x': found.x, 'P': found.P,
            'u': data.inputs[data.input[at]],
        }  # fmt: skip
        self._by_sensor = {}
        for s, name in enumerate(given.names):
            own = np.flatnonzero(self._sensor == s)
            if len(own):
                fields = found.readings[s]._asdict() | {
                    'index': given.indices[s][row[own]], 'R': data.covariances[s][row[own]],
                    'whitened': np.clip(found.readings[s].whitened, -_FAR, _FAR), 'at': own,
                }  # fmt: skip
                self._by_sensor[name] = fields

    def field(self, field: str, sensor: str) -> Any:
        """Return a field of all events, or of those of a sensor."""
        if not sensor:
            return self._whole[field]
        own = self._by_sensor.get(sensor)
        if own is None:
            return _NOTHING
        return own[field] if field in own else self._whole[field][own['at']]

    @property
    def passage(self) -> Passage:
        """The pass, whose events are made when they are used."""
        count = len(self._sensor)
        return Passage(_Later(count, self._events), _Later(count, self._whitened), self.field)

    def _events(self) -> list[Event]:
        whole = [each.tolist() if each.ndim == 1 else each for each in self._whole.values()]
        corrections = {name: self._corrections(own) for name, own in self._by_sensor.items()}
        events = []
        for name, *step in zip(*whole):
            index, *correction = next(corrections[name])
            values: Any = (name, index, *step, *correction)
            events.append(Event(*values))
        return events

    @staticmethod
    def _corrections(own: Mapping[str, Any]) -> Iterator[Any]:
        """Yield the last fields of each event of a sensor, in their order, behind its index."""
        fields = ('H', 'R', 'K', 'S', 'innovation', 'white')
        each = [own[field] for field in fields]
        return zip(own['index'].tolist(), *each, own['log'].tolist())

    def _whitened(self) -> list[Array]:
        each = {name: iter(own['whitened']) for name, own in self._by_sensor.items()}
        return [next(each[name]) for name in self._whole['sensor'].tolist()]


def _steps(
    given: _Readings, belief: Gaussian, gate: tuple[str, float] | None = None
) -> Iterator[tuple[float, tuple[Event, Array] | None]]:
    """Yield the time of each reading of a pass from a belief, with its event if it is fused."""
    scenario, data = computed(given.evidence.scenario), given.data
    filter, limits = ExtendedKalmanFilter(scenario.model), given.limits(gate)
    sensors = [scenario.sensors[name].sensor for name in given.names]
    known, F, Q, before = False, *_no_step(belief), nan
    for time, dt, act, s, row in zip(
        *(each.tolist() for each in (data.time, data.dt, data.input, data.sensor, data.row))
    ):
        u = data.inputs[act]
        if dt > 0.0:
            belief, F_k, Q_k = filter.linearized(belief, u, dt)
            F, Q = (scaled(F_k, F), sandwich(F_k, Q, Q_k)) if known else (F_k, Q_k)
            known = True
        if s < 0:
            continue
        if not is_finite(belief.mean):
            raise np.linalg.LinAlgError('the estimate is not finite')
        sensor = sensors[s].with_covariance(data.covariances[s][row])
        found: Any = filter.correct(belief, data.readings[s][row], sensor)
        before = time if isnan(before) else before
        if found.nis > limits[s]:
            yield time, None
            continue
        nu, S = found.innovation, found.innovation_covariance
        white, log_size = whitener(S)
        index = int(given.indices[s][row])
        event = Event(
            given.names[s], index, time, F, Q, time - before, *belief, u,
            found.jacobian, sensor.covariance, found.gain, S, nu, white, log_size,
        )  # fmt: skip
        known, F, Q, before, belief = False, *_no_step(belief), time, found.posterior
        yield time, (event, np.minimum(np.maximum(white.dot(nu), -_FAR), _FAR))


def _no_step(belief: Gaussian) -> tuple[Array, Array]:
    return identity(belief.mean.size), np.zeros(belief.covariance.shape)


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


def rejected(evidence: Evidence, name: str, limit: float) -> Array:
    """Return the readings of a sensor, by index, that a gate at a NIS rejects."""
    given = _ordered(evidence)
    found, last = _run_filter(given, _initial_belief(given, inf), (name, limit), strict=False)
    indices = given.indices[given.names.index(name)]
    judged = indices[evidence.sensors[name].stamp[indices] <= last]
    return np.array(judged[~np.isin(judged, found.terms(name).index)], dtype=int)


def usable(record: SensorRecord) -> Any:
    """Return the mask (N,) of usable readings: finite, with a positive definite covariance."""
    finite: Any = np.isfinite(record.value).all(axis=1) & np.isfinite(record.stamp)
    sound: Any = np.isfinite(record.covariance).all(axis=(1, 2))
    lowest = np.linalg.eigvalsh(np.where(sound[:, None, None], record.covariance, 0.0))[:, 0]
    return finite & sound & (lowest > 0.0)


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
