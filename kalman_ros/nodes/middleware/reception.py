# SPDX-License-Identifier: Apache-2.0
"""When messages were received, in the order in which they are handed over."""

from __future__ import annotations

#: The longest time, in nanoseconds, that a message is behind another one that was sent again; by
#: more, a clock has gone back.
_LONGEST = 5_000_000_000


class ReceptionTimes:
    """The times of reception on one topic, which do not decrease from message to message.

    A message that is lost on its way is sent again. Those after it have been received earlier by
    then, and wait for it: what was received says nothing of the order in which they are handed
    over, and a recording in the order of these times would have another one.
    """

    def __init__(self) -> None:
        self._last = 0

    def __call__(self, received: int) -> int:
        """Return the time in nanoseconds for the next message, ``received`` at this one."""
        if not 0 < self._last - received < _LONGEST:
            self._last = received
        return self._last
