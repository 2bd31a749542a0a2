# SPDX-License-Identifier: Apache-2.0
"""Filtering and smoothing of arrays, by the engine that the estimator node runs."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kalman_ros.core import (
    Array,
    ArrayLike,
    Gaussian,
    Model,
    Sensor,
    TimedSensor,
    Value,
)
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.consistency import chi_square_gate
from kalman_ros.estimators.correction import Correction
from kalman_ros.estimators.filter import Plan
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.smoother import Filtered
from kalman_ros.estimators.smoother import smooth as smooth_steps
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Innovations, Series

from .accept import belief_of, numbers
from .estimates import Estimates, Record
from .readings import Rows, parts_of, readings_of, rows_of, sensors_of, times_of
from .scenarios import load


def filter(
    model: Model | Scenario | str,
    sensors: Any = None,
    times: Any = None,
    readings: Any = None,
    inputs: ArrayLike | None = None,
    initial: Any = None,
    *,
    filter: str = '',
    input_times: ArrayLike | None = None,
    gates: float | Mapping[str, float] | None = None,
    options: Mapping[str, Value] | None = None,
) -> Estimates:
    """Return what a filter makes of readings: ``filter(model, sensor, times, readings)``.

    Parameters
    ----------
    model
        A model, or a scenario or the name of one, which has sensors and a first belief, too.
    sensors
        One sensor, several by name ``{'gps': ..., 'imu': ...}``, or a pair (H, R) in place of one.
    times
        In seconds (N,), in any order and at any distance; by name, ``{'gps': ..., 'imu': ...}``,
        if sensors have times of their own. A discrete-time model may do without: a row a period.
    readings
        (N, k), or (N,) of a sensor with one number; of several sensors by name, or with all
        columns side by side. A row that is NaN was not read; of one that is NaN in part, the
        rest is used.
    inputs
        (N, m), each in effect from its time until the next, or one for all; zero by default.
    initial
        The belief at the first time, before its readings: a `Gaussian`, or a pair of mean and
        covariance, of which a number or a diagonal is enough.
    filter
        ``'kf'``, ``'ekf'``, ``'ukf'``, ``'gaussian_sum'``, ``'steady_state'`` or ``'luenberger'``;
        by default that of the scenario, or ``'kf'`` where all is linear and ``'ekf'`` else.
    input_times
        Where the inputs have times of their own.
    gates
        With which probability a good reading is to pass, such as 0.999, for all sensors or by
        name; others are rejected, and counted.
    options
        Of the filter: ``{'alpha': 0.5}``.

    Raises
    ------
    ValueError
        If anything does not fit, with the name of the argument.
    """
    task = _task(model, sensors, initial, filter)
    rows = readings_of(times, readings, task.sensors, task.model)
    if not any(len(each.time) for each in rows.values()):
        raise ValueError('readings: expected at least one row, got none')
    acts = _inputs(task.model, inputs, input_times, times, rows)
    return _Pass(task, rows, acts, gates, options or {}).estimates()


def smooth(estimates: Estimates) -> Estimates:
    """Return the same estimates with all readings, later ones too, in each of them.

    By Rauch, Tung and Striebel; for models that are not linear about the filter's own estimates,
    or through its sigma points. Times may be uneven, readings missing.

    Raises
    ------
    ValueError
        If the estimates are not those of `filter` with a kf, ekf or ukf.
    """
    if not isinstance(estimates, Estimates) or estimates.smoothed:
        what = 'smoothed ones' if isinstance(estimates, Estimates) else type(estimates).__name__
        raise ValueError(f'estimates: expected what kr.filter returns, got {what}')
    record = estimates.record
    found = smooth_steps(record.filter, record.steps)
    shown = [found[index] for index in record.shown]
    return replace(
        estimates,
        mean=np.array([belief.mean for belief in shown]),
        covariance=np.array([belief.covariance for belief in shown]),
        nis=np.full(len(shown), np.nan),
        innovations={},
        smoothed=True,
    )


@dataclass(frozen=True)
class _Task:
    """What is to be estimated, by what."""

    model: Model
    sensors: Mapping[str, Sensor]
    initial: Gaussian
    filter: str


def _task(model: Any, sensors: Any, initial: Any, filter: str) -> _Task:
    if isinstance(model, (str, Scenario)):
        scenario = load(model)
        model, filter = scenario.model, filter or scenario.filter
        if sensors is None:
            sensors = {name: source.sensor for name, source in scenario.enabled.items()}
        initial = scenario.initial_belief if initial is None else initial
    if not isinstance(model, Model):
        raise ValueError(f'model: expected a model or a scenario, got {type(model).__name__}')
    if sensors is None:
        raise ValueError('sensors: expected a sensor, several by name, or a pair (H, R)')
    named = sensors_of(sensors, model)
    if not filter:
        plan = Plan(model, {name: TimedSensor(s, 1.0) for name, s in named.items()}, 1.0)
        filter = 'kf' if plan.linear else 'ekf'
    return _Task(model, named, belief_of(initial, model), filter)


def _inputs(
    model: Model, inputs: Any, input_times: Any, times: Any, rows: Mapping[str, Rows]
) -> Rows:
    """Return the inputs with their stamps; one for all begins with the first reading."""
    m = model.input.size
    if inputs is not None and not m:
        raise ValueError('inputs: expected none, for the model has no input')
    if inputs is None:
        inputs = np.zeros(m)
    array = numbers('inputs', inputs)
    if not np.isfinite(array).all():
        raise ValueError('inputs: expected finite numbers')
    start = min(float(each.time.min()) for each in rows.values() if len(each.time))
    constant = array.ndim == 0 or (array.ndim == 1 and array.size == m and m != 1) or (
        m == 1 and array.size == 1
    )  # fmt: skip
    if constant and input_times is None:
        return rows_of('inputs', [start], array.reshape(1, m), m, model)
    if input_times is None:
        if isinstance(times, Mapping):
            raise ValueError('input_times: expected the times of the inputs, got nothing')
        return rows_of('inputs', next(iter(rows.values())).time, array, m, model)
    return rows_of('inputs', times_of('input_times', input_times), array, m, model)


@dataclass
class _Log:
    """Of one sensor: what became of each row that was read."""

    time: list[float] = field(default_factory=list)
    corrections: list[tuple[Array, Array, float]] = field(default_factory=list)

    def add(self, time: float, present: Array, correction: Correction) -> None:
        """Take in a correction; numbers that were missing stay NaN."""
        values, std = np.full((2, present.size), np.nan)
        values[present] = correction.innovation
        std[present] = np.sqrt(correction.innovation_covariance.diagonal())
        self.time.append(time)
        self.corrections.append((values, std, correction.nis))

    def innovations(self, k: int) -> Innovations:
        """Return all of them as arrays."""
        columns = list(zip(*self.corrections)) or [(), (), ()]
        values, std = (np.array(column, dtype=float).reshape(-1, k) for column in columns[:2])
        return Innovations(np.array(self.time), values, std, np.array(columns[2], dtype=float))


class _Pass:
    """One pass of the online estimator over rows in the order of time."""

    def __init__(
        self,
        task: _Task,
        rows: Mapping[str, Rows],
        acts: Rows,
        gates: Any,
        options: Mapping[str, Value],
    ) -> None:
        self._task, self._rows = task, rows
        #: By stamp: the readings (sensor, the one that reads, row, values), and the inputs.
        self._readings = defaultdict[int, list[tuple[str, Sensor, int, Array]]](list)
        self._acts: dict[int, Array] = dict(zip(acts.stamps, acts.values))
        self._seconds: dict[int, float] = dict(zip(acts.stamps, acts.time.tolist()))
        known: dict[str, Sensor] = {}
        owners: dict[str, str] = {}
        for name, each in rows.items():
            known[name], owners[name] = task.sensors[name], name
            for index, sensor, y in parts_of(name, task.sensors[name], each):
                known[sensor.name], owners[sensor.name] = sensor, name
                self._readings[each.stamps[index]].append((name, sensor, index, y))
            self._seconds.update(zip(each.stamps, each.time.tolist()))
        self._shown = {stamp for each in rows.values() for stamp in each.stamps}
        self._filter = build_filter(task.filter, _plan(task, rows), options)
        before = np.zeros(task.model.input.size)
        limits = _limits(gates, known, owners)
        policy = Policy(window=0.0, max_gap=0.0, restart_after=0, gates=limits)
        self._online = OnlineEstimator(self._filter, known, task.initial, before, policy)
        self._input = before
        self._logs = {name: _Log() for name in rows}
        self.counts: dict[str, Counter[str]] = {name: Counter() for name in rows}

    def estimates(self) -> Estimates:
        """Return what all rows make of the first belief."""
        stamps = sorted(self._seconds)
        self._online.add_input(stamps[0], self._input)  # the first belief holds here
        nis, degrees, likelihood = [], [], 0.0
        steps: list[Filtered] = []
        for stamp in stamps:
            step, corrections = self._step(stamp)
            steps.append(step)
            nis.append(sum(c.nis for c in corrections) if corrections else np.nan)
            degrees.append(sum(c.innovation.size for c in corrections))
            likelihood += sum(map(log_likelihood, corrections))
        shown = [index for index, stamp in enumerate(stamps) if stamp in self._shown]
        return Estimates(
            state=self._task.model.state,
            time=np.array([self._seconds[stamps[index]] for index in shown]),
            mean=np.array([steps[index].belief.mean for index in shown]),
            covariance=np.array([steps[index].belief.covariance for index in shown]),
            nis=np.array(nis)[shown],
            degrees=np.array(degrees)[shown],
            innovations={
                name: log.innovations(self._task.sensors[name].output.size)
                for name, log in self._logs.items()
            },
            readings={name: Series(each.time, each.values) for name, each in self._rows.items()},
            outputs={name: self._task.sensors[name].output for name in self._rows},
            counts={name: dict(counter) for name, counter in self.counts.items()},
            log_likelihood=likelihood,
            filter=self._task.filter,
            record=Record(self._filter, steps, shown),
        )

    def _step(self, stamp: int) -> tuple[Filtered, list[Correction]]:
        """Take in all of one time; return the belief after it and what was fused."""
        online, fused, restarts = self._online, list[Correction](), self._online.restarts
        broken = False
        for name, sensor, index, y in self._readings.get(stamp, ()):
            outcome, correction = online.add_reading(sensor.name, stamp, y)
            self.counts[name][outcome.value] += 1
            if correction is not None:
                present = np.isfinite(self._rows[name].values[index])
                self._logs[name].add(self._seconds[stamp], present, correction)
            if outcome.accepted and correction is not None:
                fused.append(correction)
            broken |= outcome is Outcome.RECOVERED
        if stamp in self._acts:
            self._input = self._acts[stamp]
            online.add_input(stamp, self._input)
        belief = online.predicted(stamp)
        broken |= online.restarts > restarts
        return Filtered(stamp, belief, self._input, broken), fused


def log_likelihood(correction: Correction) -> float:
    """Return log N(innovation; 0, S)."""
    S = correction.innovation_covariance
    _, log_determinant = np.linalg.slogdet(2.0 * np.pi * S)
    return -0.5 * (correction.nis + float(log_determinant))


def _plan(task: _Task, rows: Mapping[str, Rows]) -> Plan:
    """Return what a filter is built for; rates matter to those whose gains are constant."""
    rates = dict.fromkeys(task.sensors, 1.0)
    for name, each in rows.items():
        gaps = np.diff(np.unique(each.stamps)) * 1e-9
        if gaps.size:
            rates[name] = 1.0 / float(np.median(gaps))
    timed = {name: TimedSensor(sensor, rates[name]) for name, sensor in task.sensors.items()}
    return Plan(task.model, timed, max(rates.values()))


def _limits(
    gates: Any, known: Mapping[str, Sensor], owners: Mapping[str, str]
) -> dict[str, float]:
    """Return the largest NIS of each sensor, and part of one, that passes its gate."""
    if gates is None:
        return {}
    names = dict.fromkeys(owners.values())
    by_name = gates if isinstance(gates, Mapping) else dict.fromkeys(names, gates)
    found = {}
    for name, probability in by_name.items():
        if name not in names:
            raise ValueError(f"gates: '{name}' is not one of the sensors ({', '.join(names)})")
        if not 0.0 < probability <= 1.0:
            raise ValueError(f'gates: expected a probability such as 0.999, got {probability:g}')
        for own, sensor in known.items():
            if probability < 1.0 and owners[own] == name:
                found[own] = chi_square_gate(float(probability), sensor.output.size)
    return found
