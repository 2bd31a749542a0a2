# SPDX-License-Identifier: Apache-2.0
"""The possible outcomes of a reading."""

from __future__ import annotations

from enum import Enum


class Outcome(Enum):
    """The outcome of a reading. Every reading has exactly one."""

    #: Whether the reading moved the estimate.
    accepted: bool
    #: Whether it is what the configuration intends for a reading that is in order.
    intended: bool
    #: Whether the reader of the message can name the field and the reason.
    explained: bool

    #: Hash by identity: the hash of `Enum`, by name, takes longer than the counting.
    __hash__ = object.__hash__

    FUSED = 'fused'
    WEAKENED = 'fused: with less weight, outside the soft gate'
    RECOVERED = 'fused: covariance widened after too many rejections'
    REJECTED = 'rejected: outside the gate'
    OUTVOTED = 'rejected: contradicts sensors that agree'
    INDEFINITE = 'rejected: the update has no finite positive result'
    NOT_FINITE = 'dropped: not finite'
    WRONG_SIZE = 'dropped: wrong size'
    BAD_COVARIANCE = 'dropped: covariance not positive definite'
    NO_FIX = 'dropped: no position fix'
    ABSENT = 'dropped: the message says that it has none'
    FIRST_POSE = 'kept: others are compared with it'
    NO_TRANSFORM = 'dropped: no transform of its frame'
    MOVING = 'not used: not at rest'
    SWITCHED_OFF = 'not used: fusion is switched off'
    OTHER_FRAME = 'dropped: in another frame than declared'
    DUPLICATE = 'dropped: duplicate stamp'
    TOO_OLD = 'dropped: older than the window'
    OVERRUN = 'dropped: too many messages waiting'
    FUTURE = 'dropped: stamped in the future'


_ACCEPTED = {Outcome.FUSED, Outcome.WEAKENED, Outcome.RECOVERED}
_INTENDED = {
    Outcome.FUSED, Outcome.WEAKENED, Outcome.MOVING, Outcome.SWITCHED_OFF, Outcome.FIRST_POSE
}  # fmt: skip
_EXPLAINED = {
    Outcome.WRONG_SIZE, Outcome.NO_FIX, Outcome.ABSENT, Outcome.OTHER_FRAME, Outcome.NO_TRANSFORM
}  # fmt: skip
for _outcome in Outcome:
    _outcome.accepted = _outcome in _ACCEPTED
    _outcome.intended = _outcome in _INTENDED
    _outcome.explained = _outcome in _EXPLAINED
