# SPDX-License-Identifier: Apache-2.0
"""Pass of an extended Kalman filter in the order of stamps, with the matrices of each step.

A replay has the results of the online estimator, which processes readings as they are received. A
pass has the results of a filter that processes the readings in order, and its linearisation, from
which the responses of innovations to faults are computed; see `responses`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isnan, log, nan, pi
from typing import Any

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


@dataclass(frozen=True)
class Passage:
    """The events of a filter pass, with whitened innovations e = L^-1 nu where S = L L'."""

    events: list[Event]
    whitened: list[Array]

    @property
    def misfit(self) -> float:
        """Misfit of the pass, the sum of e'e + log |2 pi S|, which is -2 log likelihood."""
        squares = sum(float(e.dot(e)) for e in self.whitened)
        return squares + sum(event.log for event in self.events)

    @cached_property
    def mean_square(self) -> float:
        """Mean square of the whitened innovations, each up to 5 deviations; 1 is expected."""
        e = np.concatenate([np.zeros(0), *self.whitened])
        return float(np.mean(np.square(np.clip(e, -_OUTLIER, _OUTLIER)))) if len(e) else 1.0

    @cached_property
    def _indices(self) -> dict[str, list[int]]:
        by_sensor = defaultdict[str, list[int]](list)
        for index, event in enumerate(self.events):
            by_sensor[event.sensor].append(index)
        return by_sensor

    @cached_property
    def terms(self) -> dict[tuple[str, int], tuple[float, float, int]]:
        """Square e'e, log |2 pi S| and size of each reading, by sensor and index."""
        return {
            (event.sensor, event.index): (float(e.dot(e)), event.log, len(e))
            for event, e in zip(self.events, self.whitened)
        }

    def first(self, count: int) -> Passage:
        """Return the first events."""
        return Passage(self.events[:count], self.whitened[:count])

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

    def of(self, sensor: str) -> Array:
        """Return the indices of the events of a sensor."""
        return np.array(self._indices.get(sensor, []), dtype=int)

    def events_of(self, sensor: str) -> list[Event]:
        """Return the events of a sensor."""
        return [self.events[i] for i in self._indices.get(sensor, [])]

    def whitened_of(self, sensor: str) -> Array:
        """Return the whitened innovations of a sensor (E, k)."""
        return np.array([self.whitened[i] for i in self._indices.get(sensor, [])])

    def squares(self, sensor: str) -> Array:
        """Return the squares e'e of the whitened innovations of a sensor (E,)."""
        return np.array([e @ e for e in self.whitened_of(sensor)])


def passage(evidence: Evidence, until: float = inf, strict: bool = True) -> Passage:
    """Run an extended Kalman filter over the usable readings, up to a stamp (s).

    Duplicates and readings that are not `usable` are omitted.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the filter fails and the pass is ``strict``; otherwise the pass ends there.
    """
    data = _ordered(evidence, until)
    events, whitened, _ = _run_filter(data, _initial_belief(data, until), strict=strict)
    return Passage(events, whitened)


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
) -> tuple[list[Event], list[Array], float]:
    """Return the events of a pass from the ``first`` belief, and their whitened innovations.

    The last result is the time until which readings were processed, if the filter fails and the
    pass is not ``strict``; inf otherwise. A ``gate`` (sensor, largest NIS) omits the readings
    beyond it.
    """
    at_once = _matrices(given, first, gate)
    if at_once is not None:
        return *_events(given, at_once), inf
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
    return [event for event, _ in found], [e for _, e in found], last


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


def _events(given: _Readings, found: StepMatrices) -> tuple[list[Event], list[Array]]:
    """Return the events of a pass, and their whitened innovations."""
    data = given.data
    at = np.flatnonzero(found.fused)
    sensor, time = data.sensor[at].tolist(), data.time[at]
    each = [
        zip(readings.H, R[rows], *readings[1:-1], np.clip(readings.whitened, -_FAR, _FAR))
        for readings, R, rows in zip(found.readings, data.covariances, _fused_rows(found, data))
    ]
    indices = [given.indices[s][r] for s, r in zip(sensor, data.row[at].tolist())]
    steps: Any = zip(
        (given.names[s] for s in sensor), map(int, indices), time.tolist(), found.F, found.Q,
        np.diff(time, prepend=time[:1]).tolist(), found.x, found.P, data.inputs[data.input[at]],
    )  # fmt: skip
    events, whitened = [], []
    for s, step in zip(sensor, steps):
        *matrices, log_size, e = next(each[s])
        whole: Any = (*step, *matrices, float(log_size))
        events.append(Event(*whole))
        whitened.append(e)
    return events, whitened


def _fused_rows(found: StepMatrices, data: OrderedData) -> Iterator[Any]:
    """Yield the readings of each sensor that are fused, by index."""
    for s in range(len(data.readings)):
        yield data.row[found.fused & (data.sensor == s)]


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
    first = _initial_belief(given, inf)
    events, _, last = _run_filter(given, first, (name, limit), strict=False)
    fused = [event.index for event in events if event.sensor == name]
    indices = given.indices[given.names.index(name)]
    judged = indices[evidence.sensors[name].stamp[indices] <= last]
    return np.array(judged[~np.isin(judged, fused)], dtype=int)


def usable(record: SensorRecord) -> Any:
    """Return the mask (N,) of usable readings: finite, with a positive definite covariance."""
    finite: Any = np.isfinite(record.value).all(axis=1) & np.isfinite(record.stamp)
    sound: Any = np.isfinite(record.covariance).all(axis=(1, 2))
    lowest = np.linalg.eigvalsh(np.where(sound[:, None, None], record.covariance, 0.0))[:, 0]
    return finite & sound & (lowest > 0.0)


def explained_in_both(before: Passage, after: Passage) -> float:
    """Return the reduction of the misfit of the readings that are in both passes."""
    old, new = before.terms, after.terms
    pairs = ((old[key], new[key]) for key in old if key in new)
    return sum(a[0] + a[1] - b[0] - b[1] for a, b in pairs)


def explained(before: Passage, after: Passage) -> float:
    """Return the reduction of the misfit by a correction.

    A reading that the correction omits counts by the excess of its misfit over the expectation.
    """
    gain = 0.0
    for key, (square, log_size, k) in before.terms.items():
        if key in after.terms:
            gain += square + log_size - after.terms[key][0] - after.terms[key][1]
        else:
            gain += square - k - DROPPED
    return gain


#: Cost of the omission of a reading in -2 log likelihood, as of a reading at about 3 sigma.
DROPPED = 10.0
