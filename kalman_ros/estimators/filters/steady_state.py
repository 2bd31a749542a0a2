# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter with its steady-state gains."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np

from kalman_ros.core import Array, DesignError
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.estimators.plan import Plan
from kalman_ros.linear.periodic import periodic_filter

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
        names, phases = plan.phases()
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


FILTER = SteadyStateKalmanFilter
