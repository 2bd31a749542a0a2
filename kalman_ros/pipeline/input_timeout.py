# SPDX-License-Identifier: Apache-2.0
"""Robots stop when commands cease: an input that is not renewed becomes the idle input."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators.timeline import Arrival


class InputTimeout:
    """Timeout that ends an input a fixed time after the last one.

    By stamps, not by the clock: a recording gives the same inputs as the live topics.

    Parameters
    ----------
    timeout
        Seconds until the input ends; 0 for never.
    idle
        Input (m,) after the end.
    """

    def __init__(self, timeout: float, idle: Array) -> None:
        self._timeout, self._idle = round(timeout * 1e9), idle
        #: Time at which the input ends, in nanoseconds; None if it has ended.
        self._due: int | None = None

    @property
    def is_set(self) -> bool:
        """Whether inputs end."""
        return self._timeout > 0

    def on_input(self, time: int) -> None:
        """Record the stamp of an input, in nanoseconds."""
        if self._timeout:
            due = time + self._timeout
            self._due = due if self._due is None else max(self._due, due)

    def before_end(self, time: Any, now: Any, acts: Any) -> int:
        """Return how many messages come before an input ends, of many with stamps ``time`` (S,).

        ``now`` (S,) are their times of arrival, and ``acts`` (S,) whether they are inputs.
        """
        if not self._timeout:
            return len(time)
        never = np.iinfo(np.int64).max
        begun = -never if self._due is None else self._due
        due = np.maximum.accumulate(np.where(acts, time + self._timeout, -never))
        due = np.maximum(np.concatenate(([-never], due[:-1])), begun)
        ended = np.minimum(time, now) > np.where(due == -never, never, due)
        return int(np.argmax(np.append(ended, True)))

    def ending(self, time: int) -> tuple[int, Array] | None:
        """Return the end of the last input and the idle input, if the end is before ``time``."""
        return None if self._due is None or time <= self._due else (self._due, self._idle)

    def ended_by(self, time: int) -> list[Arrival]:
        """Return the idle input if the last one ended before ``time``; nothing otherwise."""
        ending = self.ending(time)
        if ending is None:
            return []
        self._due = None
        return [Arrival(None, *ending)]
