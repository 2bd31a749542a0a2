# SPDX-License-Identifier: Apache-2.0
"""One pass of the online estimator over the rows of arrays."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kalman_ros.core import Array, Dynamics, Gaussian, Sensor, TimedSensor, Value
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.consistency import chi_square_gate
from kalman_ros.estimators.diffuse import Diffuse, check_start
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.smoother import Filtered
from kalman_ros.simulation.trajectory import Innovations, Series

from .estimates import Estimates, Record
from .rows import Rows, parts_of


@dataclass(frozen=True)
class Task:
    """The model, sensors and options of an estimation."""

    model: Dynamics
    sensors: Mapping[str, Sensor]
    initial: Gaussian
    filter: str
    arithmetic: str = 'numpy'


@dataclass
class _Log:
    """The outcomes of one sensor's rows."""

    time: list[float] = field(default_factory=list)
    row: list[int] = field(default_factory=list)
    corrections: list[tuple[Array, Array, float]] = field(default_factory=list)

    def add(self, time: float, row: int, correction: Correction, nis: float) -> None:
        """Add the correction by a row."""
        self.time.append(time)
        self.row.append(row)
        variances = correction.innovation_covariance.diagonal()
        self.corrections.append((correction.innovation, variances, nis))

    def innovations(self, rows: Array) -> Innovations:
        """Return all innovations as arrays; values missing in ``rows`` (N, k) stay NaN."""
        present = np.isfinite(rows[self.row])
        values, variance = np.full((2, *present.shape), np.nan)
        nis: tuple[float, ...] = ()
        if self.corrections:
            innovations, variances, nis = zip(*self.corrections)
            values[present] = np.concatenate(innovations)
            variance[present] = np.concatenate(variances)
        time = np.array(self.time)
        return Innovations(time, values, np.sqrt(variance), np.array(nis, dtype=float))


class Pass:
    """One pass of the online estimator over rows in time order."""

    def __init__(
        self,
        task: Task,
        rows: Mapping[str, Rows],
        acts: Rows,
        gates: Any,
        options: Mapping[str, Value],
    ) -> None:
        self._task, self._rows = task, rows
        #: By stamp: the readings (sensor, part, row, values), and the inputs.
        self._readings = defaultdict[int, list[tuple[str, Sensor, int, Array]]](list)
        self._acts: dict[int, Array] = dict(zip(acts.stamps, acts.values))
        self._seconds: dict[int, float] = dict(zip(acts.stamps, acts.time.tolist()))
        known: dict[str, Sensor] = {}
        owners: dict[str, str] = {}
        for name, series in rows.items():
            known[name], owners[name] = task.sensors[name], name
            for index, sensor, y in parts_of(name, task.sensors[name], series):
                known[sensor.name], owners[sensor.name] = sensor, name
                self._readings[series.stamps[index]].append((name, sensor, index, y))
            self._seconds.update(zip(series.stamps, series.time.tolist()))
        if task.model.is_discrete:
            first = min(self._seconds, default=0)
            for stamp in self._seconds:
                task.model.periods((stamp - first) * 1e-9)
        self._shown = {stamp for series in rows.values() for stamp in series.stamps}
        self._filter = build_filter(task.filter, _plan(task, rows), options)
        check_start(self._filter, task.initial, task.sensors, 'initial')
        before = np.zeros(task.model.input.size)
        limits = gate_limits(gates, known, owners)
        policy = Policy(window=0.0, max_gap=0.0, restart_after=0, gates=limits)
        self._online = OnlineEstimator(self._filter, known, task.initial, before, policy)
        self._input = before
        self._logs = {name: _Log() for name in rows}
        self.counts: dict[str, Counter[str]] = {name: Counter() for name in rows}

    def estimates(self) -> Estimates:
        """Return the estimates from all rows."""
        stamps = sorted(self._seconds)
        self._online.add_input(stamps[0], self._input)  # the time of the initial belief
        nis, degrees, likelihood = [], [], 0.0
        steps: list[Filtered] = []
        for stamp in stamps:
            known = not isinstance(self._online.belief, Diffuse)
            step, corrections = self._step(stamp, known=known)
            steps.append(step)
            judged = corrections if known else []
            nis.append(sum(c.nis for c in judged) if judged else np.nan)
            degrees.append(sum(c.innovation.size for c in judged))
            likelihood += sum(c.log_likelihood for c in corrections)
        shown = [index for index, stamp in enumerate(stamps) if stamp in self._shown]
        return Estimates(
            state=self._task.model.state,
            time=np.array([self._seconds[stamps[index]] for index in shown]),
            mean=np.array([steps[index].belief.mean for index in shown]),
            covariance=np.array([steps[index].belief.covariance for index in shown]),
            nis=np.array(nis)[shown],
            degrees=np.array(degrees)[shown],
            innovations={
                name: log.innovations(self._rows[name].values) for name, log in self._logs.items()
            },
            readings={
                name: Series(series.time, series.values) for name, series in self._rows.items()
            },
            outputs={name: self._task.sensors[name].output for name in self._rows},
            counts={name: dict(counter) for name, counter in self.counts.items()},
            log_likelihood=likelihood,
            filter=self._task.filter,
            arithmetic=self._task.arithmetic,
            restarts=self._online.restarts,
            record=Record(self._filter, steps, shown, self._slopes()),
        )

    def _slopes(self) -> dict[str, Array]:
        """Return H of the sensors that are linear."""
        rest = self._task.model.equilibrium.state
        sensors = {name: self._task.sensors[name] for name in self._rows}
        return {name: sensor.jacobian(rest) for name, sensor in sensors.items() if sensor.linear}

    def _step(self, stamp: int, *, known: bool) -> tuple[Filtered, list[Correction]]:
        """Process the rows of one time; return the belief after it and the fused readings.

        Readings have no NIS unless all states were ``known`` before.
        """
        online, fused, restarts = self._online, list[Correction](), self._online.restarts
        broken = False
        for name, sensor, index, y in self._readings.get(stamp, ()):
            outcome, correction = online.add_reading(sensor.name, stamp, y)
            self.counts[name][outcome.value] += 1
            if correction is not None:
                nis = float(correction.nis) if known else np.nan
                self._logs[name].add(self._seconds[stamp], index, correction, nis)
            if outcome.accepted and correction is not None:
                fused.append(correction)
            broken |= outcome is Outcome.RECOVERED
        if stamp in self._acts:
            self._input = self._acts[stamp]
            online.add_input(stamp, self._input)
        belief = online.predicted(stamp)
        broken |= online.restarts > restarts
        return Filtered(stamp, belief, self._input, broken), fused


def _plan(task: Task, rows: Mapping[str, Rows]) -> Plan:
    """Return the plan of a filter; rates matter for constant gains."""
    rates = dict.fromkeys(task.sensors, 1.0)
    for name, series in rows.items():
        gaps = np.diff(np.unique(series.stamps)) * 1e-9
        if gaps.size:
            rates[name] = 1.0 / float(np.median(gaps))
    timed = {name: TimedSensor(sensor, rates[name]) for name, sensor in task.sensors.items()}
    return Plan(task.model, timed, max(rates.values()))


def gate_limits(
    gates: Any, known: Mapping[str, Sensor], owners: Mapping[str, str]
) -> dict[str, float]:
    """Return the largest accepted NIS of each sensor, and of parts of it."""
    if gates is None:
        return {}
    names = dict.fromkeys(owners.values())
    by_name = gates if isinstance(gates, Mapping) else dict.fromkeys(names, gates)
    limits = {}
    for name, probability in by_name.items():
        if name not in names:
            raise ValueError(f"gates: '{name}' is not one of the sensors ({', '.join(names)})")
        if not 0.0 < probability <= 1.0:
            raise ValueError(f'gates: expected a probability such as 0.999, got {probability:g}')
        for part, sensor in known.items():
            if probability < 1.0 and owners[part] == name:
                limits[part] = chi_square_gate(float(probability), sensor.output.size)
    return limits
