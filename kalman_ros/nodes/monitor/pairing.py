# SPDX-License-Identifier: Apache-2.0
"""Matches whole covariances, whose messages have no stamp, with estimates."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Gaussian

#: The number of unmatched messages kept.
_KEPT = 1000


class Pairing:
    """Pairs estimates with covariances that agree with the part that the estimate contains.

    Either may be lost: messages older than a pair are dropped.
    """

    def __init__(self) -> None:
        self._beliefs: list[tuple[int, Gaussian]] = []
        self._wholes: list[Array] = []

    def estimate(self, time: int, belief: Gaussian) -> tuple[int, Gaussian] | None:
        """Add an estimate, whose covariance may have zeros; return the resulting pair."""
        self._beliefs.append((time, belief))
        del self._beliefs[:-_KEPT]
        of = next((i for i, P in enumerate(self._wholes) if _agree(belief.covariance, P)), None)
        return None if of is None else self._pair(len(self._beliefs) - 1, of)

    def covariance(self, whole: Array) -> tuple[int, Gaussian] | None:
        """Add a covariance (n, n); return the resulting pair."""
        self._wholes.append(whole)
        del self._wholes[:-_KEPT]
        beliefs = (belief for _, belief in self._beliefs)
        at = next((i for i, b in enumerate(beliefs) if _agree(b.covariance, whole)), None)
        return None if at is None else self._pair(at, len(self._wholes) - 1)

    def _pair(self, at: int, of: int) -> tuple[int, Gaussian]:
        (time, belief), whole = self._beliefs[at], self._wholes[of]
        del self._beliefs[: at + 1], self._wholes[: of + 1]
        return time, Gaussian(belief.mean, whole)


def _agree(covariance: Array, whole: Array) -> bool:
    """Return whether ``whole`` equals the nonzero part of ``covariance``."""
    part = covariance != 0.0
    return np.array_equal(covariance[part], whole[part])
