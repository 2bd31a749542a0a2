# SPDX-License-Identifier: Apache-2.0
"""Work beside a loop: one job at a time, and of those that wait only the newest."""

from __future__ import annotations

import sys
from collections.abc import Callable
from threading import Thread
from time import monotonic
from typing import Generic, TypeVar

T = TypeVar('T')

#: Does the work; it calls its argument often, which raises where its result is of no more use.
Job = Callable[[Callable[[], None]], T]

#: Seconds after which a thread passes the interpreter on: the loop must not wait for longer.
_SWITCH = 0.0005
#: A job that takes longer, in seconds, is given up for a newer one, but not two in a row.
_PATIENCE = 2.0


class ObsoleteError(Exception):
    """The result of a job is of no more use."""


class NewestJob(Generic[T]):
    """Does one job at a time in a thread, and then the newest of those that were added meanwhile.

    All methods are called by the loop, in one thread. A result has to be taken before the next
    job starts, which may thus depend on it.

    Parameters
    ----------
    waits
        Whether a job is done at once, in the caller's thread: in lockstep, the result must not
        depend on the time that it takes.
    """

    def __init__(self, *, waits: bool) -> None:
        self._waits = waits
        self._next: Callable[[], Job[T]] | None = None
        self._running: _Running[T] | None = None
        self._took, self._gave_up = 0.0, False

    @property
    def is_waiting(self) -> bool:
        """Return whether a job waits for the result of another to be taken."""
        return self._next is not None

    @property
    def took(self) -> float:
        """Return how long the job whose result was taken last has taken, in seconds."""
        return self._took

    def start(self, prepare: Callable[[], Job[T]]) -> None:
        """Do a job in place of those that wait; ``prepare`` returns it when it is next."""
        self._next = prepare
        self._proceed()

    def forget(self) -> None:
        """Forget all jobs, and what they result in."""
        self._next = None
        if self._running is not None:
            self._running.forgotten = True

    def take(self) -> T | Exception | None:
        """Return the result of a job, or its error, once; None before it is done."""
        running = self._running
        if running is None or not running.done:
            self._proceed()
            return None
        self._running = None
        self._took = running.took
        self._gave_up = isinstance(running.outcome, ObsoleteError) and not running.forgotten
        if running.forgotten or isinstance(running.outcome, ObsoleteError):
            self._proceed()
            return None
        return running.outcome

    def _proceed(self) -> None:
        """Start the next job, if none runs."""
        if self._running is not None:
            if self._next is not None and not self._gave_up:  # not one after the other
                self._running.hurried = True
            return
        if self._next is None:
            return
        job, self._next = self._next(), None
        self._running = _Running(job)
        if self._waits:
            self._running.work()
            return
        sys.setswitchinterval(_SWITCH)
        Thread(target=self._running.work, daemon=True).start()


class _Running(Generic[T]):
    """A job that is being done."""

    def __init__(self, job: Job[T]) -> None:
        self._job = job
        self._began = monotonic()
        self.outcome: T | Exception | None = None
        self.took = 0.0
        #: Whether a newer one waits, or its result is not wanted any more.
        self.hurried = self.forgotten = False
        self.done = False

    def work(self) -> None:
        """Do the job; whatever it raises is its outcome."""
        try:
            self.outcome = self._job(self._check)
        except Exception as error:
            self.outcome = error
        except BaseException as error:  # a model of the user's that ends the program
            self.outcome = RuntimeError(f'{type(error).__name__}: {error}')
        self.took = monotonic() - self._began
        self.done = True

    def _check(self) -> None:
        if self.forgotten or (self.hurried and monotonic() - self._began > _PATIENCE):
            raise ObsoleteError
