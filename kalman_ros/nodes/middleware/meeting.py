# SPDX-License-Identifier: Apache-2.0
"""Discovery in real time: a node that starts waits until the others are connected."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

#: The longest wait, in seconds, for nodes that may never start.
_LONGEST = 1.0


class Meeting:
    """Decides when a node that has just become active may publish.

    Nodes that start together discover each other one by one. If an input reaches the estimator
    but not yet the plant, which rests until its first input, the estimator predicts a motion that
    does not happen; and vice versa. So a new node publishes nothing that others act upon until
    they are connected.

    Parameters
    ----------
    met
        Returns whether the required nodes are connected.
    """

    def __init__(self, met: Callable[[], bool]) -> None:
        self._met = met
        self._end = monotonic() + _LONGEST
        self._over = False

    @property
    def over(self) -> bool:
        """Whether they are connected, or the wait is over."""
        self._over = self._over or self._met() or monotonic() > self._end
        return self._over
