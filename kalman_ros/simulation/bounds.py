# SPDX-License-Identifier: Apache-2.0
"""How well any estimator can do at best."""

from __future__ import annotations

import numpy as np

from kalman_ros.control.lqe import Readings, corrected
from kalman_ros.core import Array, symmetric

from .scenario import Scenario


def posterior_cramer_rao(scenario: Scenario, truth: Array, input: Array) -> Array:
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
    """
    model, plan = scenario.model, scenario.plan
    P = scenario.initial_belief.covariance
    bounds = [P]
    for step, (x, u) in enumerate(zip(truth[:-1], input), start=1):
        move = model.transition(x, u, plan.dt)
        P = symmetric(move.F @ P @ move.F.T + move.Q)
        for name in plan.due(step):
            sensor = plan.sensors[name].sensor
            _, P = corrected(P, Readings(sensor.jacobian(truth[step]), sensor.covariance))
        bounds.append(P)
    return np.array(bounds)
