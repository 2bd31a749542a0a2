# SPDX-License-Identifier: Apache-2.0
"""Which whole covariance belongs to which estimate: the message that has it has no stamp."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array, Gaussian

#: So many of either are kept for what may still come.
_KEPT = 50


class Pairing:
    """Pairs estimates with covariances that agree with the part that the estimate carries.

    Either may be lost: what is older than a pair is given up.
    """

    def __init__(self) -> None:
        self._beliefs: list[tuple[int, Gaussian]] = []
        self._wholes: list[Array] = []

    def estimate(self, time: int, belief: Gaussian) -> Iterator[tuple[int, Gaussian]]:
        """Take an estimate, whose covariance may have zeros; yield the pairs that this makes."""
        self._beliefs = [*self._beliefs[-_KEPT:], (time, belief)]
        return self._pairs()

    def covariance(self, whole: Array) -> Iterator[tuple[int, Gaussian]]:
        """Take a covariance (n, n); yield the pairs that this makes."""
        self._wholes = [*self._wholes[-_KEPT:], whole]
        return self._pairs()

    def _pairs(self) -> Iterator[tuple[int, Gaussian]]:
        while (found := self._first_pair()) is not None:
            at, of = found
            time, belief = self._beliefs[at]
            pair = time, Gaussian(belief.mean, self._wholes[of])
            del self._beliefs[: at + 1], self._wholes[: of + 1]
            yield pair

    def _first_pair(self) -> tuple[int, int] | None:
        for at, (_, belief) in enumerate(self._beliefs):
            own = belief.covariance
            part = own != 0.0
            for of, whole in enumerate(self._wholes):
                if np.array_equal(own[part], whole[part]):
                    return at, of
        return None
