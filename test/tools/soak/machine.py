# SPDX-License-Identifier: Apache-2.0
"""Resource use of a process on Linux: memory, and processor time withheld from it."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_PROC = Path('/proc')
_PAGE = os.sysconf('SC_PAGE_SIZE')
_TICK = 1.0 / os.sysconf('SC_CLK_TCK')
#: In the first line of /proc/stat, after the name: proc(5).
_STEAL = 7


class Usage(NamedTuple):
    """The resources of a process so far.

    Parameters
    ----------
    resident
        Memory in use, in bytes.
    delayed
        Time for which its threads were ready to run but had to wait, in seconds.
    """

    resident: int
    delayed: float


def usage(pid: int, threads: Collection[str] = ()) -> Usage:
    """Return the resources of a process; ProcessLookupError if there is none.

    Delays are those of all its threads, or of its first and of those with the names ``threads``.
    """
    process = _PROC / str(pid)
    delayed = 0.0
    try:
        resident = int((process / 'statm').read_text().split()[1]) * _PAGE
        for thread in (process / 'task').iterdir():
            with suppress(FileNotFoundError):  # a thread may end meanwhile
                name = (thread / 'comm').read_text().strip()
                if threads and thread.name != str(pid) and name not in threads:
                    continue
                delayed += int((thread / 'schedstat').read_text().split()[1]) * 1e-9
    except FileNotFoundError:
        raise ProcessLookupError(f'there is no process {pid}') from None
    return Usage(resident, delayed)


class Withheld:
    """The time for which the machine has kept processes from running, since its creation.

    Parameters
    ----------
    pids
        The processes; those that end no longer count.
    threads
        As in `usage`: other threads do not matter.
    """

    def __init__(self, pids: Iterable[int], threads: Collection[str] = ()) -> None:
        self._threads = threads
        self._before = {pid: usage(pid, threads).delayed for pid in pids}
        self._stolen = _stolen()

    def __call__(self) -> float:
        """Return the sum over the processes, in seconds, including time stolen by the host."""
        waited = _stolen() - self._stolen
        for pid, before in self._before.items():
            with suppress(ProcessLookupError):
                waited += usage(pid, self._threads).delayed - before
        return waited


def _stolen() -> float:
    """Return the seconds for which the host gave this machine's processors to others."""
    line = (_PROC / 'stat').read_text().partition('\n')[0]
    return int(line.split()[1 + _STEAL]) * _TICK
