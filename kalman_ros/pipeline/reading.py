# SPDX-License-Identifier: Apache-2.0
"""Readings and inputs on their way from a message into the estimate."""

from __future__ import annotations

from typing import Any, NamedTuple

from kalman_ros.core import Array
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.timeline import Arrival


class Reading(Arrival):
    """A decoded reading of a sensor, or a known input, and its outcome.

    Parameters
    ----------
    source
        Name of the sensor; None for an input.
    time
        Stamp in nanoseconds; None without a stamp, until the time of arrival stands for it.
    values
        Reading (k,), or input (m,); (0,) if it cannot be used.
    covariance
        Covariance of the message (k, k); None where the configured one applies.
    outcome
        Reason why the reading cannot be used; None before it is fused.
    completed
        Whether the configured covariance is used, since the message has zeros.
    """

    __slots__ = 'completed', 'correction', 'outcome', 'stamped'
    source: Any
    time: Any
    outcome: Any

    def __init__(
        self,
        source: str | None,
        time: int | None,
        values: Array,
        covariance: Array | None = None,
        outcome: Outcome | None = None,
        completed: bool = False,
    ) -> None:
        self.source, self.time, self.values, self.covariance = source, time, values, covariance
        self.outcome, self.completed = outcome, completed
        #: Whether the message has a stamp.
        self.stamped = time is not None
        #: Correction of the belief, if one was computed.
        self.correction: Correction | None = None


class Readings(NamedTuple):
    """Decoded messages of a sensor.

    Parameters
    ----------
    time
        Stamps (N,) in nanoseconds; None if the messages have none.
    values, covariance
        Readings (N, k), and the covariances (N, k, k) with which they are used.
    completed
        Whether the configured covariance is used for a part that the message leaves out (N,).
    """

    time: Any
    values: Array
    covariance: Array
    completed: Any

    def some(self, which: slice) -> Readings:
        """Return some of them, one behind the other."""
        time = None if self.time is None else self.time[which]
        columns = (column[which] for column in self[1:])
        return Readings(time, *columns)
