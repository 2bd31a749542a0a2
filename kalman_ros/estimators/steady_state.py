# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter with the gains that it settles to."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from kalman_ros.core import Array, DesignError, Gaussian, solve

from .filter import Plan, sampled_system
from .fixed_gain import FixedGainObserver
from .kf import KalmanFilter

#: So many seconds' worth of steps without convergence mean that there is no steady state.
_MOST_STEPS = 200_000


def build(plan: Plan) -> FixedGainObserver:
    """Return the observer whose gains are those of the Kalman filter in steady state.

    The Riccati recursion runs over the sensors' schedule until the covariance repeats; where
    rates differ, a sensor's gain is its average over the period. With one rate the gain is that
    of the discrete algebraic Riccati equation.

    Raises
    ------
    DesignError
        If the sensors do not keep the error bounded.
    ValueError
        If the model is not linear.
    """
    system = sampled_system('steady_state', plan)
    filter = KalmanFilter(system)
    x, u = np.zeros(system.state.size), np.zeros(system.input.size)
    P = np.eye(len(x))
    for _ in range(_MOST_STEPS // plan.period):
        start, gains = P, defaultdict[str, list[Array]](list)
        for step in range(plan.period):
            belief = filter.predict(Gaussian(x, P), u, plan.dt)
            for name in plan.due(step):
                sensor = plan.sensors[name].sensor
                C, R = sensor.jacobian(x), sensor.covariance
                P_prior = belief.covariance
                gains[name].append(solve(C @ P_prior @ C.T + R, C @ P_prior).T)
                belief = filter.correct(belief, sensor.measure(x), sensor).posterior
            P = belief.covariance
        if not np.all(np.isfinite(P)) or np.trace(P) > 1e100:
            break
        # relative to standard deviations: what is nearly uncorrelated has no digits of its own
        std = np.sqrt(P.diagonal())
        if np.all(np.abs(P - start) <= 1e-12 * np.outer(std, std)):
            means = {name: np.mean(each, axis=0) for name, each in gains.items()}
            return FixedGainObserver(system, means)
    raise DesignError('filter: the error has no steady state with these sensors')
