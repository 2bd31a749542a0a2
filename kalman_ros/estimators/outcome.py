# SPDX-License-Identifier: Apache-2.0
"""What can become of a reading."""

from __future__ import annotations

from enum import Enum


class Outcome(Enum):
    """What became of a reading. Every reading has exactly one."""

    #: Each is itself alone; that of `Enum`, by name, takes longer than counting by it.
    __hash__ = object.__hash__

    FUSED = 'fused'
    RECOVERED = 'fused: covariance widened after too many rejections'
    REJECTED = 'rejected: outside the gate'
    OUTVOTED = 'rejected: contradicts sensors that agree'
    INDEFINITE = 'rejected: the update has no finite positive result'
    NOT_FINITE = 'dropped: not finite'
    WRONG_SIZE = 'dropped: wrong size'
    BAD_COVARIANCE = 'dropped: covariance not positive definite'
    DUPLICATE = 'dropped: a reading with this stamp was there'
    TOO_OLD = 'dropped: older than the window'
    OVERRUN = 'dropped: more came than could be taken in'
    FUTURE = 'dropped: stamped in the future'

    @property
    def accepted(self) -> bool:
        """Whether the reading moved the estimate."""
        return self is Outcome.FUSED or self is Outcome.RECOVERED
