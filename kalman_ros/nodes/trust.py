# SPDX-License-Identifier: Apache-2.0
"""Which estimates may be acted upon."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, Space, is_finite


class Trust:
    """Says of each estimate why it is not to be acted upon, if so.

    Parameters
    ----------
    space
        Of the state.
    timeout
        Seconds by which an estimate may be old; 0 for any.
    most
        The largest standard deviation of each state (n,); infinite for any.
    prior
        The variance of each state (n,) with which an estimator starts.
    """

    def __init__(self, space: Space, timeout: float, most: Array, prior: Array) -> None:
        self._space = space
        self.adopt(timeout, most, prior)
        self.forget()

    def adopt(self, timeout: float, most: Array, prior: Array) -> None:
        """Use other limits from now on."""
        self._timeout, self._most, self._prior = timeout, most, prior

    def forget(self) -> None:
        """Compare the next estimate with none before it."""
        self._last: int | None = None
        self._first: Array | None = None
        self._variances: Array = np.empty(0)

    def reason(self, estimate: Sample, now: int | None) -> str:
        """Return why not to act upon an estimate that came at ``now``; nothing if all is well.

        Times are in nanoseconds; ``now`` is None where the age of a stamp means nothing. A time
        that went back is told once: the next estimate is compared with this one.
        """
        time, last = estimate.time, self._last
        self._last = time
        if not is_finite(estimate.values):
            return 'the estimate is not finite'
        if time is not None and last is not None and time < last:
            self.forget()
            self._last = time
            return f'the time of the estimate went back by {(last - time) * 1e-9:.3g} s'
        if time is not None and now is not None and self._timeout:
            age = (now - time) * 1e-9
            if age > self._timeout:
                return f'the estimate is {age:.3g} s old'
            if age < -self._timeout:
                return f'the estimate is {-age:.3g} s ahead of the clock'
        P = estimate.covariance
        if P is None:
            return ''
        started_anew = self._restart(P.diagonal())
        return self._doubt(P) or started_anew

    def _restart(self, variances: Array) -> str:
        """Tell whether what was known well is known no better than at first, all at once."""
        before, self._variances = self._variances, variances
        if self._first is None:
            self._first = variances
            return ''
        # at first: before any reading, and as it was when this one came to know it
        first = np.array([self._prior, self._first])
        lost = np.any((variances > 0.5 * first) & (before < 0.01 * first), axis=0)
        names = [name for name, is_lost in zip(self._space.names, lost.tolist()) if is_lost]
        return (
            f'the estimator started anew: {names[0]} is as uncertain as at first' if names else ''
        )

    def _doubt(self, P: Array) -> str:
        if np.isinf(self._most).all():
            return ''
        variances = P.diagonal()
        if not is_finite(P) or np.any(variances < 0.0):
            return 'the covariance of the estimate is none'
        over = np.flatnonzero(variances > self._most**2)
        if not over.size:
            return ''
        first = over[0]
        name, std, most = self._space.names[first], np.sqrt(variances[first]), self._most[first]
        return f'the estimate of {name} is uncertain by {std:.3g}, more than {most:g}'
