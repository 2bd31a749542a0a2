# SPDX-License-Identifier: Apache-2.0
"""What the machine did to a process, as Linux tells it: memory given, processor time withheld."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_PROC = Path('/proc')
_PAGE = os.sysconf('SC_PAGE_SIZE')
_TICK = 1.0 / os.sysconf('SC_CLK_TCK')
#: In the first line of /proc/stat, after the name: proc(5).
_STEAL = 7


class Usage(NamedTuple):
    """What a process has had so far.

    Parameters
    ----------
    resident
        Memory that it occupies now, in bytes.
    delayed
        Time for which its threads could have run and were made to wait, in seconds.
    """

    resident: int
    delayed: float


def usage(pid: int) -> Usage:
    """Return what a process has had; ProcessLookupError if there is none."""
    process = _PROC / str(pid)
    delayed = 0.0
    try:
        resident = int((process / 'statm').read_text().split()[1]) * _PAGE
        for thread in (process / 'task').iterdir():
            with suppress(FileNotFoundError):  # a thread may end meanwhile
                delayed += int((thread / 'schedstat').read_text().split()[1]) * 1e-9
    except FileNotFoundError:
        raise ProcessLookupError(f'there is no process {pid}') from None
    return Usage(resident, delayed)


class Withheld:
    """For how long, since it was made, the machine has kept processes from running.

    Parameters
    ----------
    pids
        The processes; those that end no longer count.
    """

    def __init__(self, pids: Iterable[int]) -> None:
        self._before = {pid: usage(pid).delayed for pid in pids}
        self._stolen = _stolen()

    def __call__(self) -> float:
        """Return the sum over the processes, in seconds, with what the host gave to others."""
        waited = _stolen() - self._stolen
        for pid, before in self._before.items():
            with suppress(ProcessLookupError):
                waited += usage(pid).delayed - before
        return waited


def _stolen() -> float:
    """Return the seconds for which this machine's own host gave its processors to others."""
    line = (_PROC / 'stat').read_text().partition('\n')[0]
    return int(line.split()[1 + _STEAL]) * _TICK
