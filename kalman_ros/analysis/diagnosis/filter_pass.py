# SPDX-License-Identifier: Apache-2.0
"""Pass of an extended Kalman filter over readings in the order of their stamps.

A replay has the results of the online estimator, which processes readings as they are received. A
pass has the results of a filter that processes them in order, and its linearisation.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import inf, isnan, nan
from typing import Any

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.compiled.parts import VARIABLE
from kalman_ros.core import Array, Gaussian, is_finite
from kalman_ros.core.ordered_data import OrderedData, StepMatrices
from kalman_ros.estimators import filter_class
from kalman_ros.estimators.diffuse import Diffuse
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.plan import all_parts
from kalman_ros.linear.matrices import identity
from kalman_ros.linear.single import sandwich, scaled
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.computed import computed

from .beginning import likeliest
from .evidence import Evidence
from .passage import NOTHING, Event, Later, Passage, whitener

#: Normalised innovations are limited to this magnitude.
_FAR = 1e6
#: Normalised squares are limited to this value for the choice of an initial belief, since larger
#: squares are those of outliers.
_OUTLYING = 30.0


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
        return [limit if sensor == name else inf for sensor in self.names]


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
    last = max((float(of_sensor[-1]) for of_sensor in times if len(of_sensor)), default=-inf)
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
    fused_events, last = list[tuple[Event, Array]](), -inf
    try:
        for time, fused in _steps(given, first, gate):
            last = time
            if fused is not None:
                fused_events.append(fused)
        last = inf
    except np.linalg.LinAlgError:
        if strict:
            raise
    return Passage([event for event, _ in fused_events], [e for _, e in fused_events]), last


def _matrices(
    given: _Readings, first: Gaussian, gate: tuple[str, float] | None
) -> StepMatrices | None:
    """Return the matrices of a pass in C; None where it needs a step after the other."""
    if isinstance(first, Diffuse):
        return None
    scenario, data = _computed(given.evidence.scenario, os.environ.get(VARIABLE)), given.data
    sensors = [scenario.sensors[name].sensor for name in given.names]
    limits = given.limits(gate)
    counts = all_parts(scenario.model, data.dt)
    return scenario.model.filter_pass((*first,), data, counts, sensors, limits)


class _Table:
    """The events of a pass in C, by their fields."""

    def __init__(self, given: _Readings, matrices: StepMatrices) -> None:
        data, at = given.data, np.flatnonzero(matrices.fused)
        self._sensor, row, time = data.sensor[at], data.row[at], data.time[at]
        names = [*given.names, '']  # a pass without a reading has names, too
        self._whole = {
            'sensor': np.array(names)[self._sensor], 'time': time,
            'F': matrices.F, 'Q': matrices.Q,
            'dt': np.diff(time, prepend=time[:1]), 'x': matrices.x, 'P': matrices.P,
            'u': data.inputs[data.input[at]],
        }  # fmt: skip
        self._by_sensor = {}
        for s, name in enumerate(given.names):
            events = np.flatnonzero(self._sensor == s)
            if len(events):
                fields = matrices.readings[s]._asdict() | {
                    'index': given.indices[s][row[events]], 'R': data.covariances[s][row[events]],
                    'whitened': np.clip(matrices.readings[s].whitened, -_FAR, _FAR), 'at': events,
                }  # fmt: skip
                self._by_sensor[name] = fields

    def field(self, field: str, sensor: str) -> Any:
        """Return a field of all events, or of those of a sensor."""
        if not sensor:
            return self._whole[field]
        fields = self._by_sensor.get(sensor)
        if fields is None:
            return NOTHING
        return fields[field] if field in fields else self._whole[field][fields['at']]

    @property
    def passage(self) -> Passage:
        """The pass, whose events are made when they are used."""
        count = len(self._sensor)
        return Passage(Later(count, self._events), Later(count, self._whitened), self.field)

    def _events(self) -> list[Event]:
        whole = [value.tolist() if value.ndim == 1 else value for value in self._whole.values()]
        corrections = {name: self._corrections(fields) for name, fields in self._by_sensor.items()}
        events = []
        for name, *step in zip(*whole):
            index, *correction = next(corrections[name])
            values: Any = (name, index, *step, *correction)
            events.append(Event(*values))
        return events

    @staticmethod
    def _corrections(fields: Mapping[str, Any]) -> Iterator[Any]:
        """Yield the last fields of each event of a sensor, in their order, behind its index."""
        names = ('H', 'R', 'K', 'S', 'innovation', 'white')
        columns = [fields[name] for name in names]
        return zip(fields['index'].tolist(), *columns, fields['log'].tolist())

    def _whitened(self) -> list[Array]:
        rows = {name: iter(fields['whitened']) for name, fields in self._by_sensor.items()}
        return [next(rows[name]) for name in self._whole['sensor'].tolist()]


@lru_cache(maxsize=4)
def _computed(scenario: Scenario, arithmetic: str | None) -> Scenario:
    """Return a scenario that is computed with, the same for many passes."""
    return computed(scenario)


def _steps(
    given: _Readings, belief: Gaussian, gate: tuple[str, float] | None = None
) -> Iterator[tuple[float, tuple[Event, Array] | None]]:
    """Yield the time of each reading of a pass from a belief, with its event if it is fused."""
    scenario, data = _computed(given.evidence.scenario, os.environ.get(VARIABLE)), given.data
    filter, limits = ExtendedKalmanFilter(scenario.model), given.limits(gate)
    sensors = [scenario.sensors[name].sensor for name in given.names]
    known, F, Q, before = False, *_no_step(belief), nan
    for time, dt, act, s, row in zip(
        *(column.tolist() for column in (data.time, data.dt, data.input, data.sensor, data.row))
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
        correction: Any = filter.correct(belief, data.readings[s][row], sensor)
        before = time if isnan(before) else before
        if correction.nis > limits[s]:
            yield time, None
            continue
        nu, S = correction.innovation, correction.innovation_covariance
        white, log_size = whitener(S)
        index = int(given.indices[s][row])
        event = Event(
            given.names[s], index, time, F, Q, time - before, *belief, u,
            correction.jacobian, sensor.covariance, correction.gain, S, nu, white, log_size,
        )  # fmt: skip
        known, F, Q, before, belief = False, *_no_step(belief), time, correction.posterior
        yield time, (event, np.minimum(np.maximum(white.dot(nu), -_FAR), _FAR))


def _no_step(belief: Gaussian) -> tuple[Array, Array]:
    return identity(belief.mean.size), np.zeros(belief.covariance.shape)


def rejected(evidence: Evidence, name: str, limit: float) -> Array:
    """Return the readings of a sensor, by index, that a gate at a NIS rejects."""
    given = _ordered(evidence)
    gated, last = _run_filter(given, _initial_belief(given, inf), (name, limit), strict=False)
    indices = given.indices[given.names.index(name)]
    judged = indices[evidence.sensors[name].stamp[indices] <= last]
    return np.array(judged[~np.isin(judged, gated.terms(name).index)], dtype=int)


def usable(record: SensorRecord) -> Any:
    """Return the mask (N,) of usable readings: finite, with a positive definite covariance."""
    finite: Any = np.isfinite(record.value).all(axis=1) & np.isfinite(record.stamp)
    sound: Any = np.isfinite(record.covariance).all(axis=(1, 2))
    R = np.where(sound[:, None, None], record.covariance, 0.0)
    if (R[:1] == R).all():  # one for all
        R = R[:1]
    return finite & sound & (np.linalg.eigvalsh(R)[:, 0] > 0.0)
