# SPDX-License-Identifier: Apache-2.0
"""The error covariance of a filter whose readings repeat with a period.

Sensors at different rates, and sensors that are read one after the other, make a Kalman filter
periodic instead of constant (S. Bittanti, P. Colaneri, G. De Nicolao, The periodic Riccati
equation, in The Riccati Equation, 1991). A phase predicts and then takes its readings:

    P- = F P F' + Q,    L = P- C' (C P- C' + R)^-1,    P = (I - L C) P- (I - L C)' + L R L'

which is the Riccati recursion. An observer with another L has the same recursion with that gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np

from .errors import DesignError
from .matrices import Array, solve, symmetric
from .single import joseph, sandwich

#: After this many periods without convergence the covariance is taken to grow without bound.
_MOST_PERIODS = 100_000
_UNBOUNDED = 1e100
#: After its periods at once, a recursion has this many to settle, step by step.
_MOST_LEFT = 1000
#: The error covariance has settled when a period changes it by less, relative to its size.
_SETTLED = 1e-12


@dataclass(frozen=True)
class Readings:
    """The readings of one step of a period.

    Parameters
    ----------
    C, R
        The stacked matrix (k, n), and the covariance (k, k); k may be 0.
    gain
        L (n, k) of an observer; None for the gain with the least error.
    """

    C: Array
    R: Array
    gain: Array | None = None


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
    L = readings.gain
    if L is None:
        L = solve(sandwich(C, P, R), C @ P).T
    return L, joseph(L, C, P, R)


class _Map(NamedTuple):
    """What some steps make of an error covariance: P -> A (I + P J)^-1 P A' + C, all (n, n)."""

    A: Array
    C: Array
    J: Array

    def __call__(self, P: Array) -> Array:
        """Return the error covariance after the steps."""
        return symmetric(self.A @ _divided(P, self.J) @ self.A.T + self.C)

    def then(self, later: _Map) -> _Map:
        """Return these steps and later ones as one."""
        n = len(self.A)
        inverse = np.linalg.inv(np.eye(n) + self.C @ later.J)
        return _Map(
            later.A @ inverse @ self.A,
            symmetric(later.A @ inverse @ self.C @ later.A.T + later.C),
            symmetric(self.A.T @ later.J @ inverse @ self.A + self.J),
        )


def _divided(P: Array, J: Array) -> Array:
    """Return (I + P J)^-1 P."""
    return np.asarray(np.linalg.solve(np.eye(len(P)) + P @ J, P))


def _map_of(phase: Phase) -> _Map:
    """Return a phase as a map."""
    F, Q, H, R = phase.F, phase.Q, phase.readings.C, phase.readings.R
    if not R.size:
        return _Map(F, Q, np.zeros_like(F))
    L = phase.readings.gain
    if L is not None:
        return _Map(F - L @ H @ F, joseph(L, H, Q, R), np.zeros_like(F))
    S = sandwich(H, Q, R)
    K, H_F = solve(S, H @ Q).T, H @ F
    return _Map(F - K @ H_F, joseph(K, H, Q, R), symmetric(H_F.T @ solve(S, H_F)))


@np.errstate(all='ignore')
def _advanced(phases: Sequence[Phase], P: Array, periods: int) -> tuple[Array, bool]:
    """Return the error covariance after a number of ``periods`` or more, and if it has settled.

    Each map is the one before it twice, so that a hundred thousand periods take seventeen (B.
    Anderson and J. Moore, Optimal Filtering, 1979, section 6.7; for the maps, S. Sarkka and A.
    Garcia-Fernandez, Temporal Parallelization of Bayesian Smoothers, IEEE Trans. Automatic Control
    66(1), 2021).

    Raises
    ------
    numpy.linalg.LinAlgError
        If a map cannot be computed.
    """
    total = reduce(_Map.then, map(_map_of, phases))
    covariance = total(P)
    for _ in range(periods.bit_length()):
        total = total.then(total)
        before, covariance = covariance, total(P)
        if not np.isfinite(covariance).all():
            raise np.linalg.LinAlgError('the maps grow beyond all numbers')
        if _settled(before, covariance):
            return covariance, True
    return covariance, False


def _settled(before: Array, after: Array) -> bool:
    """Return whether an error covariance changes by nothing that counts.

    That is relative to the deviations: a covariance near zero is rounding and never settles.
    """
    std = np.sqrt(np.maximum(after.diagonal(), 0.0))
    return bool(np.all(np.abs(after - before) <= _SETTLED * np.outer(std, std)))


def periodic_filter(phases: Sequence[Phase], periods: int = _MOST_PERIODS) -> PeriodicFilter:
    """Return what the recursion over ``phases`` settles to within a number of ``periods``.

    Raises
    ------
    DesignError
        If it does not settle: the readings do not keep the error bounded.
    """
    first = np.eye(len(phases[0].F)) * max(1.0, float(np.trace(phases[0].Q)))
    starts = [(first, periods)]
    try:
        advanced, settled = _advanced(phases, first, periods)
    except np.linalg.LinAlgError:
        pass
    else:
        # rounding, where readings are very good, may keep the steps from what doubling settled at
        starts = [(advanced, min(periods, _MOST_LEFT)), *(starts if settled else [])]
    for start, count in starts:
        steady = _stepped(phases, start, count)
        if steady is not None:
            return steady
    raise DesignError('the error covariance has no steady state with these sensors')


def _stepped(phases: Sequence[Phase], after: Array, periods: int) -> PeriodicFilter | None:
    """Return what the recursion settles to, step by step; None if it does not."""
    prior, posterior = (np.zeros((len(phases), *after.shape)) for _ in range(2))
    gains = [np.zeros((len(after), len(phase.readings.C))) for phase in phases]
    for _ in range(periods):
        start = after
        for k, phase in enumerate(phases):
            P = symmetric(phase.F @ after @ phase.F.T + phase.Q)
            gains[k], after = updated(P, phase.readings)
            prior[k], posterior[k] = P, after
        if _settled(start, after):
            return PeriodicFilter(prior, posterior, gains)
        if not np.trace(after) <= _UNBOUNDED:  # or not a number
            return None
    return None
