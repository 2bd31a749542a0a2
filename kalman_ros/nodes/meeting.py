# SPDX-License-Identifier: Apache-2.0
"""The first moments of a node in real time, in which it and the others find each other."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

#: No meeting takes longer, in seconds: whoever is not there by then may never be.
_LONGEST = 1.0


class Meeting:
    """Tells when a node that has just become active may speak.

    What comes together finds each other one by one. If a force reaches the estimator and not yet
    the plant, which rests until its first force, the estimator believes in a motion that there
    is not; and the other way round. So whoever is new says nothing that others act upon before
    it and they are connected.

    Parameters
    ----------
    met
        Tells whether those are connected that must be.
    """

    def __init__(self, met: Callable[[], bool]) -> None:
        self._met = met
        self._end = monotonic() + _LONGEST
        self._over = False

    @property
    def over(self) -> bool:
        """Whether they have met, or have had the time to."""
        self._over = self._over or self._met() or monotonic() > self._end
        return self._over
