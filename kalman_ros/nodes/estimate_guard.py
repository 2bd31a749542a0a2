# SPDX-License-Identifier: Apache-2.0
"""Which estimates may be acted upon."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, Space, is_finite
from kalman_ros.linear.kernels import is_definite

#: An older stamp may be that of an estimate that came late, or of a time that began again. It is
#: the latter when, for N seconds, nothing but older ones were received.
_PATIENCE = 0.25
#: By how much rounding may make the smallest eigenvalue of correlations negative; what passed
#: through float32 is as far off.
_ROUNDING = 1e-6


class EstimateGuard:
    """Says of each estimate why it is not to be acted upon, if so.

    Parameters
    ----------
    space
        Of the state.
    timeout
        Seconds by which an estimate may be old; 0 for any.
    ahead
        Seconds by which an estimate may be ahead of the clock.
    most
        The largest standard deviation of each state (n,); infinite for any.
    prior
        The variance of each state (n,) with which an estimator starts.
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
        """Set the variances (n,) up to which no estimate looks like one of a restart."""
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
        """Tell whether a newer estimate has been acted upon, so that this one is to be ignored.

        Parameters
        ----------
        time
            The stamp, in nanoseconds.
        at
            When it came, in seconds of a clock that never goes back. None where an older stamp
            means by itself that time began again, as in lockstep and after a jump of the clock.
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
        """Return why not to act upon an estimate that came at ``now``; nothing if all is well.

        Times are in nanoseconds; ``now`` is None where the age of a stamp means nothing. Only
        what is acted upon is what later ones are compared with. A time that began again is told
        once.
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
        untimely = self._untimely(estimate.time, now)
        P = estimate.covariance
        if untimely or P is None:
            return untimely
        if not is_covariance(P):
            return 'the covariance of the estimate is not finite or not positive semi-definite'
        restarted = self._restart(P.diagonal())
        return self._doubt(P) or restarted

    def _untimely(self, time: int | None, now: int | None) -> str:
        if time is None or now is None:
            return ''
        age = (now - time) * 1e-9
        if self._timeout and age > self._timeout:
            return f'the estimate is {age:.3g} s old'
        return f'the estimate is {-age:.3g} s ahead of the clock' if -age > self._ahead else ''

    def _restart(self, variances: Array) -> str:
        """Tell whether what was known well is known no better than at first, all at once."""
        before, self._variances = self._variances, variances
        if self._first is None:
            self._first = variances
            self._set_known()
            return ''
        if (variances <= self._known).all():
            return ''
        # at first: before any reading, and as it was when this one came to know it
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
    """Tell whether ``P`` (n, n) is finite and positive semi-definite, but for rounding.

    It is judged by its correlations, so that the units of the states do not matter.
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
