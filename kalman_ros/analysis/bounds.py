# SPDX-License-Identifier: Apache-2.0
"""How well any estimator can do at best."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kalman_ros.control.lqe import Readings, corrected
from kalman_ros.core import Array, symmetric
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Series


def posterior_cramer_rao(
    scenario: Scenario,
    truth: Array,
    input: Array,
    readings: Mapping[str, Series] | None = None,
) -> Array:
    """Return the posterior Cramer-Rao bound of the error covariance (N, n, n), step by step.

    The information J along a path that is known moves as

        J' = (Q + F J^-1 F')^-1 + sum of H' R^-1 H over what is read,

    with F and H taken at the truth (P. Tichavsky, C. Muravchik and A. Nehorai, Posterior
    Cramer-Rao Bounds for Discrete-Time Nonlinear Filtering, IEEE Trans. Signal Processing 46(5),
    1998). For a linear system it is the covariance of the Kalman filter; else the expectation
    over all paths is left out, which is exact where there is little process noise. It is worked
    out as J^-1, in Joseph's form: so what is known exactly, at first or later, has a bound of 0.

    Parameters
    ----------
    scenario
        The model, the sensors with their rates, and the covariance of the first belief, which
        is the bound at the first step: what is read there counts as part of it.
    truth
        The path (N, n), a state for each step of the scenario.
    input
        From each step on (N, m).
    readings
        What was really read, by sensor, with the covariance that each reading came with: then
        these count and not those that are due, at the first step, too.
    """
    model, plan = scenario.model, scenario.plan
    read = _due(scenario, len(truth)) if readings is None else _read(scenario, readings)
    P = scenario.initial_belief.covariance
    bounds = []
    for step, x in enumerate(truth):
        if step:
            move = model.transition(truth[step - 1], input[step - 1], plan.dt)
            P = symmetric(move.F @ P @ move.F.T + move.Q)
        for name, R in read.get(step, ()):
            _, P = corrected(P, Readings(plan.sensors[name].sensor.jacobian(x), R))
        bounds.append(P)
    return np.array(bounds)


#: By step: the sensors that read there, each with its covariance (k, k).
_Read = dict[int, list[tuple[str, Array]]]


def _due(scenario: Scenario, steps: int) -> _Read:
    """Return what is due after the first step."""
    sensors = scenario.plan.sensors
    return {
        step: [(name, sensors[name].sensor.covariance) for name in scenario.plan.due(step)]
        for step in range(1, steps)
    }


def _read(scenario: Scenario, readings: Mapping[str, Series]) -> _Read:
    """Return what was read, with the covariances that the estimator took for it."""
    found: _Read = {}
    for name, series in readings.items():
        source = scenario.sensors[name]
        for index, time in enumerate(series.time):
            carried = None if series.covariance is None else series.covariance[index]
            R = source.used(carried)
            R = source.sensor.covariance if R is None else R
            found.setdefault(round(time * scenario.rate), []).append((name, R))
    return found
