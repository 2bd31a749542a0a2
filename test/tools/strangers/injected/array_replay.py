# SPDX-License-Identifier: Apache-2.0
"""Replay of recorded arrays by the online estimator, as in the node of the estimator."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Any

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.analysis.diagnosis.evidence import Evidence, changed
from kalman_ros.analysis.records import Beliefs, InputRecord, SensorRecord
from kalman_ros.core import Array
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import estimation

#: Options of the policy, with the parameters of the estimator's node that set them.
_POLICY = {
    'window': 'window',
    'recover_after': 'gate_recover_after',
    'restart_after': 'restart_after',
    'max_gap': 'max_gap',
    'future_tolerance': 'future_tolerance',
    'rest_until_input': 'rest_until_input',
}


def replay(
    parameters: Mapping[str, Any],
    readings: Mapping[str, tuple[Array, Array, Array, Array | None]],
    inputs: InputRecord,
    seconds: float = inf,
) -> Evidence:
    """Replay a recording in the order of receipt, and return its evidence.

    Parameters
    ----------
    parameters
        Parameters of the estimator, flat.
    readings
        Readings by sensor: received (N,), stamp (N,), value (N, k) and the covariance (N, k, k) in
        the messages, None if they have none.
    inputs
        Commanded inputs.
    seconds
        Duration that is replayed; later readings have no outcome.
    """
    scenario = scenarios.build(parameters, with_law=False)
    run = _Replay(parameters, scenario, readings)
    arrivals = [(t, 1, '', i) for i, t in enumerate(inputs.received.tolist())]
    for name in scenario.enabled:
        received = readings[name][0].tolist() if name in readings else []
        arrivals += [(t, 0, name, i) for i, t in enumerate(received)]
    arrivals.sort()
    end = arrivals[0][0] + seconds if arrivals else inf
    for received, _, name, index in arrivals:
        if received > end:
            break
        if name:
            run.read(received, name, index)
        else:
            u = inputs.value[index]
            run.online.add_input(_stamp(inputs.stamp[index]), u)
    return Evidence(
        parameters,
        scenario,
        run.records(),
        inputs,
        run.beliefs(),
        lambda changes, seconds=inf: replay(
            changed(parameters, changes), readings, inputs, seconds
        ),
    )


def _stamp(seconds: float) -> int:
    return round(float(seconds) * 1e9)


class _Replay:
    """An online estimator, and the result of each reading."""

    def __init__(
        self, parameters: Mapping[str, Any], scenario: Scenario, readings: Mapping[str, Any]
    ) -> None:
        options = {option: parameters[key] for option, key in _POLICY.items() if key in parameters}
        estimator = estimation(scenario, Policy(**options), biases=False)
        self.online = estimator.online(np.zeros(scenario.model.input.size))
        self._scenario, self._readings = scenario, readings
        self._results: dict[str, list[Any]] = {name: [] for name in scenario.enabled}
        self._beliefs: list[tuple[float, Array, Array]] = []

    def read(self, received: float, name: str, index: int) -> None:
        """Process a reading as the node does."""
        _, stamps, values, covariances = self._readings[name]
        source, stamp = self._scenario.sensors[name], _stamp(stamps[index])
        message_covariance = None if covariances is None else covariances[index]
        R = source.used(message_covariance)
        now = _stamp(received)
        arrival = Arrival(name, stamp or now, values[index], R)
        outcome, correction = self.online.add([arrival], now)[0]
        self._results[name].append((outcome.name, correction))
        if outcome.accepted and self.online.time is not None:
            self._beliefs.append((self.online.time * 1e-9, *self.online.belief))

    def records(self) -> dict[str, SensorRecord]:
        """Return the record of every sensor."""
        return {name: self._record(name, results) for name, results in self._results.items()}

    def _record(self, name: str, results: list[Any]) -> SensorRecord:
        source, k = self._scenario.sensors[name], self._scenario.sensors[name].sensor.output.size
        no_readings = (np.zeros(0), np.zeros(0), np.zeros((0, k)), None)
        received, stamp, value, message_covariances = self._readings.get(name, no_readings)
        N = len(received)
        # as in the node, the stamp of a reading without one is the time of receipt
        stamped = stamp != 0.0
        stamp = np.where(stamped, stamp, received)
        covariance = np.broadcast_to(source.sensor.covariance, (N, k, k)).copy()
        completed = np.zeros(N, dtype=bool)
        for index in range(N if message_covariances is not None else 0):
            used = source.used(message_covariances[index])
            completed[index] = used is not None and not np.array_equal(
                used, message_covariances[index]
            )
            covariance[index] = covariance[index] if used is None else used
        innovation, S = np.full((N, k), np.nan), np.full((N, k, k), np.nan)
        nis = np.full(N, np.nan)
        for index, (_, correction) in enumerate(results):
            if correction is not None:
                innovation[index] = correction.innovation
                S[index], nis[index] = correction.innovation_covariance, correction.nis
        outcome = np.full(N, '', dtype=object)
        outcome[: len(results)] = [outcome for outcome, _ in results]
        return SensorRecord(
            received, stamp, stamped, completed, value, covariance, outcome, innovation, S, nis
        )

    def beliefs(self) -> Beliefs:
        """Return the belief after every reading that was fused."""
        time, mean, P = zip(*self._beliefs) if self._beliefs else ((), (), ())
        n = self._scenario.model.state.size
        return Beliefs(
            np.array(time), np.array(mean).reshape(-1, n), np.array(P).reshape(-1, n, n)
        )
