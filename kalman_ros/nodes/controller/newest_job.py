# SPDX-License-Identifier: Apache-2.0
"""Work beside a loop: only the newest job counts."""

from __future__ import annotations

import sys
from collections.abc import Callable
from threading import Lock, Thread
from typing import Generic, TypeVar

T = TypeVar('T')

#: Seconds after which a thread passes the interpreter on: the loop must not wait for longer.
_SWITCH = 0.0005


class NewestJob(Generic[T]):
    """Does one job at a time in a thread, and forgets all but the newest.

    Parameters
    ----------
    waits
        Whether a job is done at once, in the caller's thread: in lockstep, the result must not
        depend on the time that it takes.
    """

    def __init__(self, *, waits: bool) -> None:
        self._waits = waits
        self._lock = Lock()
        self._next: Callable[[], T] | None = None
        self._result: T | Exception | None = None
        self._busy = self._forgotten = False

    @property
    def busy(self) -> bool:
        """Whether a job is being done."""
        return self._busy

    def start(self, job: Callable[[], T]) -> None:
        """Do a job in place of those that are not done yet."""
        if self._waits:
            self._result = _outcome(job)
            return
        with self._lock:
            self._next, self._result = job, None
            if self._busy:
                return
            self._busy = True
        sys.setswitchinterval(_SWITCH)
        Thread(target=self._work, daemon=True).start()

    def forget(self) -> None:
        """Forget all jobs, and what they result in."""
        with self._lock:
            self._next, self._result = None, None
            self._forgotten = True

    def take(self) -> T | Exception | None:
        """Return the result of the newest job, or its error, once; None before it is done."""
        if self._result is None:
            return None
        with self._lock:
            result, self._result = self._result, None
        return result

    def _work(self) -> None:
        while True:
            with self._lock:
                job, self._next, self._forgotten = self._next, None, False
                if job is None:
                    self._busy = False
                    return
            result = _outcome(job)
            with self._lock:
                if self._next is None and not self._forgotten:
                    self._result = result


def _outcome(job: Callable[[], T]) -> T | Exception:
    try:
        return job()
    except Exception as error:
        return error
