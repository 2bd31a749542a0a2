# SPDX-License-Identifier: Apache-2.0
"""Recordings from simulation, with faults injected where they would arise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import pi, sin
from typing import Any

import numpy as np

from kalman_ros.analysis.diagnosis.evidence import Evidence
from kalman_ros.analysis.records import InputRecord
from kalman_ros.core import Array, Gaussian, linearize
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.scenario import Scenario, build, regulator, shipped
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.simulation.faults.body import BodyFaults, BodyOptions
from kalman_ros.simulation.faults.links import Links
from kalman_ros.simulation.noise import stream
from kalman_ros.simulation.simulated_plant import SimulatedPlant

from .array_replay import replay

#: Least delay from a publisher to the recorder, and the mean of its random part (s).
_TRANSPORT = 0.0005
#: Size and frequency of the sine that the first state of a robot with an input follows.
_REFERENCE, _FREQUENCY = 0.4, 0.1
#: Clock of the recorder when a recording begins (s); not 0, since a stamp of 0 is a fault.
_BEGIN = 1000.0


@dataclass(frozen=True)
class Readings:
    """The readings of one sensor as they were received, as `replay` takes them."""

    received: Array
    stamp: Array
    value: Array
    covariance: Array | None = None


@dataclass(frozen=True)
class Injection:
    """The faults of a recording.

    Parameters
    ----------
    links
        Options of the injector of sensor faults (`simulation.faults`), by sensor.
    body
        Options of the injector of faults where the input acts.
    plant
        Parameters of the real robot, over those of the file.
    estimator
        Parameters of the estimator, over those of the file.
    edits
        Changes of readings on the recorder's side, by sensor.
    command
        Factor of the recorded input: 2 where half of it acts.
    """

    links: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    body: Mapping[str, Any] = field(default_factory=dict)
    plant: Mapping[str, Any] = field(default_factory=dict)
    estimator: Mapping[str, Any] = field(default_factory=dict)
    edits: Mapping[str, Callable[[Readings], Readings]] = field(default_factory=dict)
    command: float = 1.0

    def __add__(self, other: Injection) -> Injection:
        """Return an injection with the faults of both."""
        links = {
            name: {**self.links.get(name, {}), **other.links.get(name, {})}
            for name in {**self.links, **other.links}
        }
        edits = {**self.edits, **other.edits}
        for name in set(self.edits) & set(other.edits):
            edits[name] = _chain(self.edits[name], other.edits[name])
        return Injection(
            links, {**self.body, **other.body}, {**self.plant, **other.plant},
            {**self.estimator, **other.estimator}, edits, self.command * other.command,
        )  # fmt: skip


def _chain(
    first: Callable[[Readings], Readings], second: Callable[[Readings], Readings]
) -> Callable[[Readings], Readings]:
    return lambda readings: second(first(readings))


def recorded(
    name: str, injection: Injection | None = None, seconds: float = 60.0, seed: int = 0
) -> Evidence:
    """Return the evidence of a recording of a shipped scenario with the injected faults."""
    wrong = injection or Injection()
    readings, inputs = simulated(name, wrong, seconds, seed)
    parameters = {**from_file(shipped.file(name), 'estimator'), **wrong.estimator}
    taken = {
        sensor: (series.received, series.stamp, series.value, series.covariance)
        for sensor, series in readings.items()
    }
    return replay(parameters, taken, inputs)


def simulated(
    name: str, wrong: Injection, seconds: float, seed: int
) -> tuple[dict[str, Readings], InputRecord]:
    """Simulate a robot whose controller takes healthy readings; return readings and inputs."""
    shipped_values = from_file(shipped.file(name), 'plant')
    real = build({**shipped_values, **wrong.plant})
    plant = SimulatedPlant(real.model, real.timed, real.rate, real.initial_state, seed)
    plant.faults = BodyFaults(BodyOptions(**wrong.body), real.model.input.size)
    links = Links(seed)
    links.configure(real.timed, wrong.links)
    act = _Controller(build(shipped_values))
    arrivals: dict[str, list[tuple[float, float, Array]]] = {sensor: [] for sensor in real.sensors}
    commands = []
    lag = stream(seed, 'transport')
    for _ in range(round(seconds * real.rate) + 1):
        time, now = plant.time, plant.time * 1e-9 + _BEGIN
        healthy = plant.readings()
        for arrival in links(time, round(now * 1e9), healthy):
            late = _TRANSPORT + lag.exponential(_TRANSPORT)
            row = (now + late, arrival.stamp * 1e-9, arrival.values)
            arrivals[arrival.name].append(row)
        u = act(now - _BEGIN, healthy)
        commands.append((now + _TRANSPORT, now, wrong.command * u))
        plant.step(u)
    readings = {sensor: _readings(rows, real, sensor) for sensor, rows in arrivals.items()}
    for sensor, edit in wrong.edits.items():
        readings[sensor] = edit(readings[sensor])
    columns = [np.array(column) for column in zip(*commands)]
    if not real.model.input.size:
        columns = [np.zeros(0), np.zeros(0), np.zeros((0, 0))]
    return readings, InputRecord(*columns)


def _readings(rows: list[tuple[float, float, Array]], real: Scenario, name: str) -> Readings:
    rows = sorted(rows, key=lambda row: row[0])
    received, stamp, value = zip(*rows) if rows else ((), (), ())
    k = real.sensors[name].sensor.output.size
    return Readings(np.array(received), np.array(stamp), np.array(value).reshape(-1, k))


class _Controller:
    """Controller of the robot: LQR about a slow sine, with a linear filter of healthy readings."""

    def __init__(self, scenario: Scenario) -> None:
        model = self._model = scenario.model
        self._x0, self._u0 = model.equilibrium
        self._u: Array = self._u0
        if not model.input.size:
            return
        linear = linearize(model, self._x0, self._u0)
        self._K = regulator.regulator(scenario)[0].gain
        self._filter = KalmanFilter(linear)
        self._sensors = {name: source.sensor for name, source in scenario.sensors.items()}
        mean, P = scenario.initial_belief
        self._belief, self._dt = Gaussian(mean - self._x0, P), 1.0 / scenario.rate

    def __call__(self, time: float, readings: Mapping[str, Array]) -> Array:
        """Return the input (m,) for the readings of a step."""
        if not self._model.input.size:
            return self._u
        if time > 0.0:
            self._belief = self._filter.predict(self._belief, self._u - self._u0, self._dt)
        for name, y in readings.items():
            sensor = self._sensors[name]
            y = y - sensor.measure(self._x0)
            self._belief = self._filter.correct(self._belief, y, sensor).posterior
        reference = np.zeros_like(self._x0)
        reference[0] += _REFERENCE * sin(2.0 * pi * _FREQUENCY * time)
        self._u = self._u0 - self._K @ (self._belief.mean - reference)
        return self._u


def values_of(edit: Callable[[Array], Array]) -> Callable[[Readings], Readings]:
    """Return an edit that changes the values (N, k) of readings."""
    return lambda readings: replace(readings, value=edit(readings.value))


def stamps_of(edit: Callable[[Array], Array]) -> Callable[[Readings], Readings]:
    """Return an edit that changes the stamps (N,) of readings."""
    return lambda readings: replace(readings, stamp=edit(readings.stamp))
