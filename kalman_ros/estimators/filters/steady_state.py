# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter with its steady-state gains."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from kalman_ros.core import Array, DesignError
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.estimators.plan import Plan
from kalman_ros.linear.periodic import Phase, Readings, periodic_filter

#: After this many steps without convergence there is no steady state.
_MOST_STEPS = 200_000


class SteadyStateKalmanFilter(FixedGainObserver):
    """An observer with the gains of the Kalman filter in steady state."""

    @classmethod
    def build(cls, plan: Plan) -> SteadyStateKalmanFilter:
        """Return the observer of a linear model.

        The Riccati recursion runs over the sensors' schedule until the covariance repeats; where
        rates differ, the gain of a sensor is its average over the period. With one rate the gain
        follows from the discrete algebraic Riccati equation.

        Raises
        ------
        DesignError
            If the sensors do not keep the error bounded.
        """
        model: Any = plan.model
        names, phases = _phases(plan)
        try:
            steady = periodic_filter(phases, _MOST_STEPS // plan.period)
        except DesignError as error:
            raise DesignError(f'filter: {error}') from None
        gains = defaultdict[str, list[Array]](list)
        for name, L in zip(names, steady.gains):
            if name is not None:
                gains[name].append(L)
        return cls(
            model, {name: np.mean(phase_gains, axis=0) for name, phase_gains in gains.items()}
        )


def _phases(plan: Plan) -> tuple[list[str | None], list[Phase]]:
    """Return the phases of a period, and the name of the sensor of each, or None.

    Sensors that are due together read in sequence, without time between them.
    """
    n = plan.model.state.size
    step = plan.model.transition(np.zeros(n), np.zeros(plan.model.input.size), plan.dt)
    names: list[str | None] = []
    phases = []
    for k in range(plan.period):
        F, Q = step.F, step.Q
        due: Sequence[str | None] = plan.due(k) or (None,)
        for name in due:
            readings = Readings(np.zeros((0, n)), np.zeros((0, 0)))
            if name is not None:
                sensor = plan.sensors[name].sensor
                readings = Readings(sensor.jacobian(np.zeros(n)), sensor.covariance)
            names.append(name)
            phases.append(Phase(F, Q, readings))
            F, Q = np.eye(n), np.zeros((n, n))
    return names, phases


FILTER = SteadyStateKalmanFilter
