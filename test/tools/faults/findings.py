# SPDX-License-Identifier: Apache-2.0
"""The results of a run under faults: errors, consistency and recovery."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.estimators.consistency import chi_square_gate, nees
from kalman_ros.simulation.trajectory import Trajectory

from .cases import Case, Promise, Schedule
from .fault_settings import Setting

#: A consistent filter's normalised error is below the quantile of this probability.
QUANTILE = 0.99
#: The least share for a consistent filter. Errors are correlated from step to step, so the
#: share of a short run scatters: of 600 without a fault, 3 s each, none was below 0.88.
LEAST_COVERAGE = 0.85
#: A stable loop ends within this share of its largest distance from the origin. It starts at 1 m.
_SHRUNK = 0.75


@dataclass(frozen=True)
class Counts:
    """The outcomes of readings, and their number."""

    published: int
    came: int
    fused: int
    rejected: int
    dropped: int

    @property
    def add_up(self) -> bool:
        """Whether every published reading was received, and counted once."""
        accounted = self.fused + self.rejected + self.dropped
        return self.published == self.came == accounted


@dataclass(frozen=True)
class Finding:
    """The result of one case with one filter.

    Parameters
    ----------
    fault, filter, promise
        The case.
    max_error
        The largest error of a position since the fault began, in m.
    bound
        The largest allowed error; the loop may go this far beyond its start, too.
    coverage
        The share of steps since the fault began whose normalised error is below its quantile.
    counts
        Of all readings.
    recovery
        Seconds from the end of the fault until all errors are within 3 standard deviations for
        good; None if that does not happen, or the fault does not end.
    warned
        Whether the estimator gave a warning on ``/diagnostics`` at the end.
    farthest, last
        The largest distance from the origin, and the largest in the last tenth, in m; both 0
        where no controller brings the positions back.
    finite
        Whether all values from estimator and controller are finite.
    """

    fault: str
    filter: str
    promise: Promise
    max_error: float
    bound: float
    coverage: float
    counts: Counts
    recovery: float | None
    warned: bool
    farthest: float
    last: float
    finite: bool

    @property
    def broken(self) -> list[str]:
        """The broken promises."""
        promises = {
            'a number published is not finite': self.finite,
            f'counts do not add up: {self.counts}': self.counts.add_up,
            f'the error of {self.max_error:.3g} m is over {self.bound:g} m': (
                self.max_error <= self.bound
            ),
            f'the loop went as far as {self.farthest:.3g} m': self.farthest <= 1.0 + self.bound,
            f'the loop is {self.last:.3g} m off in the end, of {self.farthest:.3g} m': (
                self.last <= _SHRUNK * self.farthest
            ),
            f'the covariance covers only {self.coverage:.3f}': (
                self.promise is not Promise.COVERED or self.coverage >= LEAST_COVERAGE
            ),
            'there was no warning': self.promise is not Promise.WARNED or self.warned,
        }
        return [what for what, holds in promises.items() if not holds]

    def summary(self) -> dict[str, Any]:
        """Return the finding for JSON."""
        return {**asdict(self), 'promise': self.promise.name.lower(), 'broken': self.broken}


def recovery(run: Trajectory, error: Array, end: float) -> float | None:
    """Return the seconds after ``end`` until errors stay within 3 deviations, or None."""
    std = np.sqrt(np.diagonal(run.covariance, axis1=1, axis2=2))
    outside = np.flatnonzero((np.abs(error) > 3.0 * std).any(axis=1))
    after = outside[run.time[outside] >= end]
    if not after.size:
        return 0.0
    back = after[-1] + 1
    return round(float(run.time[back]) - end, 6) if back < len(run.time) else None


def finding(
    case: Case,
    setting: Setting,
    filter: str,
    schedule: Schedule,
    space: Space,
    run: Trajectory,
    counts: Counts,
    *,
    warned: bool,
    finite: bool,
) -> Finding:
    """Return the finding of a case from its run, with time counted from its start."""
    begins = 0.0 if case.lasts or case.pose else schedule.start
    ends = 0.0 if case.pose else schedule.end
    since = run.time >= begins
    whole = space.subtract(run.estimate, run.truth)
    error, positions = whole[since], list(setting.positions)
    n = error.shape[1]
    below = nees(error, run.covariance[since]) <= chi_square_gate(QUANTILE, n)
    distance = np.abs(run.truth[:, positions]).max(axis=1) * setting.returns
    return Finding(
        fault=case.name,
        filter=filter,
        promise=case.promise,
        max_error=float(np.abs(error[:, positions]).max()),
        bound=case.bound,
        coverage=float(below.mean()),
        counts=counts,
        recovery=None if case.lasts else recovery(run, whole, ends),
        warned=warned,
        farthest=float(distance.max()),
        last=float(distance[run.time >= 0.9 * schedule.stop].max()),
        finite=finite,
    )
