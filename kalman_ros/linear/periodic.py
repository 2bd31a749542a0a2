# SPDX-License-Identifier: Apache-2.0
"""The Riccati recursion of a filter whose readings repeat with a period.

Sensors at different rates, and sensors that are read one after the other, make a Kalman filter
periodic instead of constant (S. Bittanti, P. Colaneri, G. De Nicolao, The periodic Riccati
equation, in The Riccati Equation, 1991). A phase predicts and then takes its readings:

    P- = F P F' + Q,    L = P- C' (C P- C' + R)^-1,    P = (I - L C) P- (I - L C)' + L R L'
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .errors import DesignError
from .kernels import joseph, sandwich
from .matrices import Array, solve, symmetric

#: After this many periods without convergence the covariance is taken to grow without bound.
_MOST_PERIODS = 100_000
_UNBOUNDED = 1e100
#: The error covariance has settled when a period changes it by less, relative to its size.
_SETTLED = 1e-12


@dataclass(frozen=True)
class Readings:
    """What is read at one step: the stacked C (k, n) and the covariance R (k, k); k may be 0."""

    C: Array
    R: Array


@dataclass(frozen=True)
class Phase:
    """One part of a period: x' = F x + w with w ~ N(0, Q), both (n, n), then ``readings``."""

    F: Array
    Q: Array
    readings: Readings


@dataclass(frozen=True)
class PeriodicFilter:
    """Error covariances before and after the readings of each phase (p, n, n), and the gains.

    ``gains`` has L (n, k) of each phase: x_hat += L (y - C x_hat).
    """

    prior: Array
    posterior: Array
    gains: list[Array]


def updated(P: Array, readings: Readings) -> tuple[Array, Array]:
    """Return the gain L (n, k) of readings, and the error covariance after them (n, n).

    The covariance is in Joseph's form, a sum of two squares: P - L C P cancels where readings
    are good, and loses its sign where they are very good.
    """
    C, R = readings.C, readings.R
    if not R.size:
        return np.zeros((len(P), 0)), P
    L = solve(sandwich(C, P, R), C @ P).T
    return L, joseph(L, C, P, R)


def periodic_filter(phases: Sequence[Phase], periods: int = _MOST_PERIODS) -> PeriodicFilter:
    """Return what the recursion over ``phases`` settles to within a number of ``periods``.

    Raises
    ------
    DesignError
        If it does not settle: the readings do not keep the error bounded.
    """
    after = np.eye(len(phases[0].F)) * max(1.0, float(np.trace(phases[0].Q)))
    prior, posterior = (np.zeros((len(phases), *after.shape)) for _ in range(2))
    gains = [np.zeros((len(after), len(phase.readings.C))) for phase in phases]
    for _ in range(periods):
        start = after
        for k, phase in enumerate(phases):
            P = symmetric(phase.F @ after @ phase.F.T + phase.Q)
            gains[k], after = updated(P, phase.readings)
            prior[k], posterior[k] = P, after
        std = np.sqrt(after.diagonal())
        # relative to the deviations: a covariance near zero is rounding and never settles
        if np.all(np.abs(after - start) <= _SETTLED * np.outer(std, std)):
            return PeriodicFilter(prior, posterior, gains)
        if not np.trace(after) <= _UNBOUNDED:  # or not a number
            break
    raise DesignError('the error covariance has no steady state with these sensors')
