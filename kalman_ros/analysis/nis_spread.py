# SPDX-License-Identifier: Apache-2.0
"""The scatter of the average NIS of one run of a linear filter in steady state.

The innovations nu of the filter with the least error are white (T. Kailath, An Innovations
Approach to Least-Squares Estimation, IEEE Trans. Automatic Control 13(6), 1968), so the sum of
their NIS is chi-square. Those of an observer with another gain L are correlated over time: a
reading leaves

    E[e nu'] = (I - L C) P- C' - L R

of it in the error e, which is zero for the least error, and the next innovations contain C e. Two
Gaussian vectors with the covariance X have NIS with the covariance 2 tr(S_1^-1 X' S_2^-1 X)
(Magnus and Neudecker, Matrix Differential Calculus, section 12.13).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, islice

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.estimators.plan import Plan
from kalman_ros.linear.matrices import solve
from kalman_ros.linear.periodic import PeriodicFilter, Phase, periodic_filter
from kalman_ros.linear.single import sandwich

#: The least share of a reading in the error that counts, and the most phases in which it does.
_FORGOTTEN, _MOST_PHASES = 1e-4, 100_000


def nis_variances(plan: Plan, fixed: FixedGainObserver | None) -> dict[str, float]:
    """Return the variance of the mean NIS of many readings, times their number, by sensor.

    Parameters
    ----------
    plan
        The model, the sensors and their rates; all linear.
    fixed
        An observer with fixed gains; None for the filter with the least error.
    """
    independent = {name: 2.0 * timed.sensor.output.size for name, timed in plan.sensors.items()}
    if fixed is None:
        return independent
    names, phases = plan.phases(fixed.gains)
    steady = periodic_filter(phases)
    shared: dict[str, list[float]] = {name: [] for name in plan.sensors}
    for index, name in enumerate(names):
        if name is not None:
            shared[name].append(_shared(names, phases, steady, index))
    return {
        name: variance + 2.0 * float(np.mean(shared[name]))
        for name, variance in independent.items()
    }


def _shared(
    names: Sequence[str | None], phases: Sequence[Phase], steady: PeriodicFilter, index: int
) -> float:
    """Return the covariance of the NIS of a phase with all later ones of its sensor."""

    def spread(k: int) -> Array:
        readings = phases[k].readings
        return sandwich(readings.C, steady.prior[k], readings.R)

    C, R = phases[index].readings.C, phases[index].readings.R
    P, L, S = steady.prior[index], steady.gains[index], spread(index)
    left = (P - L @ C @ P) @ C.T - L @ R
    units = np.sqrt(np.outer(P.diagonal(), S.diagonal()))
    total = 0.0
    for later in islice(cycle(range(len(phases))), index + 1, index + 1 + _MOST_PHASES):
        C, L = phases[later].readings.C, steady.gains[later]
        left = phases[later].F @ left
        if names[later] == names[index]:
            X = C @ left
            total += 2.0 * float(np.trace(solve(spread(later), X) @ solve(S, X.T)))
        left = left - L @ C @ left
        if np.all(np.abs(left) <= _FORGOTTEN * units):
            break
    return total
