# SPDX-License-Identifier: Apache-2.0
"""The checks of an estimate before a controller uses it."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, Space, is_finite, one_each
from kalman_ros.linear.single import is_definite
from kalman_ros.scenario import Scenario

from .options import RESUME, ControllerOptions

#: An older stamp is a late estimate or a reset of time. It is a reset if only older ones were
#: received for this many seconds.
_PATIENCE = 0.25
#: The most negative eigenvalue of correlations that rounding explains, including a conversion to
#: float32.
_ROUNDING = 1e-6


class EstimateGuard:
    """Returns why an estimate must not be used, if so.

    Parameters
    ----------
    space
        Of the state.
    timeout
        The largest age of an estimate in seconds; 0 for any.
    ahead
        Seconds by which an estimate may be ahead of the clock.
    most
        The largest standard deviation of each state (n,); infinite for any.
    prior
        The variance of each state (n,) at the start of an estimator.
    """

    def __init__(
        self, space: Space, timeout: float, ahead: float, most: Array, prior: Array
    ) -> None:
        self._space = space
        self.forget()
        self.adopt(timeout, ahead, most, prior)

    def adopt(self, timeout: float, ahead: float, most: Array, prior: Array) -> None:
        """Use other limits from now on."""
        self._timeout, self._ahead, self._most, self._prior = timeout, ahead, most, prior
        self._bounded = not np.isinf(most).all()
        self._set_known()

    def _set_known(self) -> None:
        """Set the variances (n,) below which no estimate looks like a reset."""
        first = self._prior if self._first is None else self._first
        self._known: Array = 0.5 * np.minimum(self._prior, first)

    def forget(self) -> None:
        """Compare the next estimate with none before it."""
        self._newest: int | None = None
        self._older_since: float | None = None
        self._went_back = 0.0
        self._first: Array | None = None
        self._variances: Array = np.empty(0)

    def is_old(self, time: int | None, at: float | None) -> bool:
        """Return whether a newer estimate was used, so that this one is ignored.

        Parameters
        ----------
        time
            The stamp, in nanoseconds.
        at
            When it was received, in seconds of a clock that never goes back. None where an older
            stamp always means a reset of time, as in lockstep and after a jump of the clock.
        """
        if time is None or self._newest is None or time >= self._newest:
            self._older_since = None
            return False
        if at is not None:
            if self._older_since is None:
                self._older_since = at
            if at - self._older_since < _PATIENCE:
                return True
        back = (self._newest - time) * 1e-9
        self.forget()
        self._went_back = back
        return False

    def reason(self, estimate: Sample, now: int | None) -> str:
        """Return why not to use an estimate received at ``now``; '' if it is valid.

        Times are in nanoseconds; ``now`` is None where the age of a stamp is meaningless. Later
        estimates are compared only with those in use. A reset of time is reported once.
        """
        reason = self._reason(estimate, now)
        if not reason:
            self._newest = estimate.time
        return reason

    def _reason(self, estimate: Sample, now: int | None) -> str:
        back, self._went_back = self._went_back, 0.0
        if back:
            return f'the time of the estimate went back by {back:.3g} s'
        if not is_finite(estimate.values):
            return 'the estimate is not finite'
        problem = self._stamp_problem(estimate.time, now)
        P = estimate.covariance
        if problem or P is None:
            return problem
        if not is_covariance(P):
            return 'the covariance of the estimate is not finite or not positive semi-definite'
        restarted = self._restart(P.diagonal())
        return self._doubt(P) or restarted

    def _stamp_problem(self, time: int | None, now: int | None) -> str:
        if time is None or now is None:
            return ''
        age = (now - time) * 1e-9
        if self._timeout and age > self._timeout:
            return f'the estimate is {age:.3g} s old'
        return f'the estimate is {-age:.3g} s ahead of the clock' if -age > self._ahead else ''

    def _restart(self, variances: Array) -> str:
        """Return whether known states became as uncertain as at the start, all at once."""
        before, self._variances = self._variances, variances
        if self._first is None:
            self._first = variances
            self._set_known()
            return ''
        if (variances <= self._known).all():
            return ''
        # at the start: before any reading, and as it was when this state became known
        first = np.array([self._prior, self._first])
        lost = np.any((variances > 0.5 * first) & (before < 0.01 * first), axis=0)
        names = [name for name, is_lost in zip(self._space.names, lost.tolist()) if is_lost]
        return f'the estimator was reset: {names[0]} is as uncertain as at first' if names else ''

    def _doubt(self, P: Array) -> str:
        if not self._bounded:
            return ''
        variances = P.diagonal()
        over = np.flatnonzero(variances > self._most**2)
        if not over.size:
            return ''
        first = over[0]
        name, std, most = self._space.names[first], np.sqrt(variances[first]), self._most[first]
        return f'the estimate of {name} is uncertain by {std:.3g}, more than {most:g}'


def is_covariance(P: Array) -> bool:
    """Return whether ``P`` (n, n) is finite and positive semi-definite up to rounding.

    It is tested by its correlations, so that the units of the states do not matter.
    """
    if not is_finite(P):
        return False
    if is_definite(P):
        return True
    variances = P.diagonal()
    if np.any(variances < 0.0):
        return False
    std = np.sqrt(variances)
    known = std > 0.0
    if P[~known].any() or P[:, ~known].any():
        return False
    R = P[known][:, known] / std[known] / std[known, np.newaxis]
    if not is_finite(R):
        return False
    return not R.size or bool(np.linalg.eigvalsh(0.5 * (R + R.T))[0] > -_ROUNDING)


def guard_limits(
    scenario: Scenario, options: ControllerOptions
) -> tuple[float, float, Array, Array]:
    """Return the limits of accepted estimates for an `EstimateGuard`."""
    most = one_each('max_std', options.max_std, scenario.model.state.size)
    if options.resume not in RESUME:
        raise ValueError(f"resume: expected {', '.join(RESUME)}, got '{options.resume}'")
    prior = scenario.initial_belief.covariance.diagonal()
    return options.estimate_timeout, options.future_tolerance, most, prior
