# SPDX-License-Identifier: Apache-2.0
"""The lower bound of the error of any estimator."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Series


def posterior_cramer_rao(
    scenario: Scenario,
    truth: Array,
    input: Array,
    readings: Mapping[str, Series] | None = None,
    time: Array | None = None,
) -> Array:
    """Return the posterior Cramer-Rao bound of the error covariance (N, n, n), step by step.

    The information J along a known path is updated by

        J' = (Q + F J^-1 F')^-1 + sum of H' R^-1 H over the readings,

    with F and H taken at the truth (P. Tichavsky, C. Muravchik and A. Nehorai, Posterior
    Cramer-Rao Bounds for Discrete-Time Nonlinear Filtering, IEEE Trans. Signal Processing 46(5),
    1998). For a linear system it is the covariance of the Kalman filter; else the expectation
    over all paths is omitted, which is exact for small process noise. It is computed
    as J^-1, the covariance of an extended filter whose mean is the truth, so that exactly known
    states have a bound of 0.

    Parameters
    ----------
    scenario
        The model, the sensors with their rates, and the covariance of the first belief, which
        is the bound at the first step: its readings count as part of it.
    truth
        The path (N, n), a state for each step of the scenario, or for each ``time``.
    input
        From each step on (N, m).
    readings
        The actual readings by sensor, each with its covariance: then these count instead of those
        that are due, at the first step, too.
    time
        With actual readings: the time (N,) of each state from the first step on, in seconds, where
        steps are missing, as in real time. In between F is that of the state before, and H that
        of the state after.
    """
    filter, plan = ExtendedKalmanFilter(scenario.model), scenario.plan
    sensors = {name: timed.sensor for name, timed in plan.sensors.items()}
    read = _due(scenario, len(truth)) if readings is None else _read(scenario, readings)
    P = scenario.initial_belief.covariance
    steps = np.arange(len(truth)) if time is None else np.rint(time * scenario.rate).astype(int)
    bounds, done = [], -1
    for k, (step, x) in enumerate(zip(steps.tolist(), truth)):
        last = max(k - 1, 0)
        for at in range(done + 1, step + 1):
            if at:
                moved = filter.predict(Gaussian(truth[last], P), input[last], plan.dt)
                P = moved.covariance
            for name, R in read.get(at, ()):
                sensor = sensors[name].with_covariance(R)
                P = filter.correct(Gaussian(x, P), sensor.measure(x), sensor).posterior.covariance
        bounds.append(P)
        done = step
    return np.array(bounds)


#: By step: the sensors that measure there, each with its covariance (k, k).
_Read = dict[int, list[tuple[str, Array]]]


def _due(scenario: Scenario, steps: int) -> _Read:
    """Return the readings due after the first step."""
    sensors = scenario.plan.sensors
    return {
        step: [(name, sensors[name].sensor.covariance) for name in scenario.plan.due(step)]
        for step in range(1, steps)
    }


def _read(scenario: Scenario, readings: Mapping[str, Series]) -> _Read:
    """Return the actual readings, with the covariances that the estimator used."""
    found: _Read = {}
    for name, series in readings.items():
        source = scenario.sensors[name]
        for index, time in enumerate(series.time):
            carried = None if series.covariance is None else series.covariance[index]
            R = source.used(carried)
            R = source.sensor.covariance if R is None else R
            found.setdefault(round(time * scenario.rate), []).append((name, R))
    return found
