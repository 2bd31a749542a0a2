# SPDX-License-Identifier: Apache-2.0
"""Real-time scheduling, where the system permits it."""

from __future__ import annotations

import os
from pathlib import Path

_THREADS = Path('/proc/self/task')


def take_priority(priority: int) -> bool:
    """Give all threads of this process, present and future, real-time priority.

    They get Linux's policy SCHED_FIFO (sched(7)), as the controllers of ros2_control do.

    Parameters
    ----------
    priority
        From 1 to 99, the most urgent.

    Returns
    -------
    permitted
        Whether the system grants it; if not, all stays as it was.
    """
    try:
        for thread in _THREADS.iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError):  # not Linux, or not permitted
        return False
    return True
