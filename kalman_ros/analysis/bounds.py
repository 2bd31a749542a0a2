# SPDX-License-Identifier: Apache-2.0
"""The lower bound of the error covariance of any estimator."""

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
    """Return the posterior Cramer-Rao bound of the error covariance (N, n, n) at each step.

    The information J along a known path is updated by

        J' = (Q + F J^-1 F')^-1 + sum of H' R^-1 H over the readings,

    with F and H taken at the truth (P. Tichavsky, C. Muravchik and A. Nehorai, Posterior
    Cramer-Rao Bounds for Discrete-Time Nonlinear Filtering, IEEE Trans. Signal Processing 46(5),
    1998). For a linear system, the bound is the covariance of the Kalman filter. For a nonlinear
    system, the expectation over all paths is omitted, which is exact for small process noise. The
    bound is computed as J^-1, the covariance of an extended Kalman filter whose mean is the truth,
    so that the bound of an exactly known state is 0.

    Parameters
    ----------
    scenario
        Model, sensors with their rates, and the covariance of the initial belief, which is the
        bound at the first step and includes the readings of that step.
    truth
        True states (N, n), one for each step of the scenario, or for each ``time``.
    input
        Input (N, m) that holds from each step on.
    readings
        Recorded readings by sensor, with the covariance of each. They replace the scheduled
        readings, including those of the first step.
    time
        Time (N,) of each state in seconds after the first step, for recorded readings where
        steps are missing, as in real time. During a gap, F is taken at the state before it, and H
        at the state after it.
    """
    filter, plan = ExtendedKalmanFilter(scenario.model), scenario.plan
    sensors = {name: timed.sensor for name, timed in plan.sensors.items()}
    readings_by_step = (
        _scheduled_readings(scenario, len(truth))
        if readings is None
        else _recorded_readings(scenario, readings)
    )
    P = scenario.initial_belief.covariance
    steps = np.arange(len(truth)) if time is None else np.rint(time * scenario.rate).astype(int)
    bounds, previous_step = [], -1
    for k, (step, x) in enumerate(zip(steps.tolist(), truth)):
        last = max(k - 1, 0)
        for substep in range(previous_step + 1, step + 1):
            if substep:
                prior = filter.predict(Gaussian(truth[last], P), input[last], plan.dt)
                P = prior.covariance
            for name, R in readings_by_step.get(substep, ()):
                sensor = sensors[name].with_covariance(R)
                P = filter.correct(Gaussian(x, P), sensor.measure(x), sensor).posterior.covariance
        bounds.append(P)
        previous_step = step
    return np.array(bounds)


#: For each step, the names of the sensors that measure, with their covariances (k, k).
_ReadingsByStep = dict[int, list[tuple[str, Array]]]


def _scheduled_readings(scenario: Scenario, steps: int) -> _ReadingsByStep:
    """Return the readings that the schedule contains after the first step."""
    sensors = scenario.plan.sensors
    return {
        step: [(name, sensors[name].sensor.covariance) for name in scenario.plan.due(step)]
        for step in range(1, steps)
    }


def _recorded_readings(scenario: Scenario, readings: Mapping[str, Series]) -> _ReadingsByStep:
    """Return the recorded readings with the covariances that the estimator used."""
    by_step: _ReadingsByStep = {}
    for name, series in readings.items():
        source = scenario.sensors[name]
        for index, time in enumerate(series.time):
            message_covariance = None if series.covariance is None else series.covariance[index]
            R = source.used(message_covariance)
            R = source.sensor.covariance if R is None else R
            by_step.setdefault(round(time * scenario.rate), []).append((name, R))
    return by_step
