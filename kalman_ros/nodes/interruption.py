# SPDX-License-Identifier: Apache-2.0
"""Signals that ask a process to end: noted at any moment, and acted upon within milliseconds."""

from __future__ import annotations

import signal
import socket
from contextlib import suppress
from pathlib import Path
from threading import Thread

from rclpy.task import Future

#: Ctrl-C, a launcher's request, a closed terminal, Ctrl-\.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
#: The name of the thread that waits for them.
WATCHER = 'signals'


class Interruption:
    """Completes a future as soon as a signal asks for the end.

    Python runs its handlers between two instructions of the main thread, and that may wait in an
    executor for as long as there is nothing to do. So a second thread waits for the byte that
    the interpreter writes at once, and completes the future, which wakes an executor that spins
    until it is done. A handler must not do that: what it interrupts may hold the future's lock.
    """

    def __init__(self) -> None:
        self.asked = Future()
        self._wait, self._wake = socket.socketpair()
        self._wake.setblocking(False)
        signal.set_wakeup_fd(self._wake.fileno(), warn_on_full_buffer=False)
        self._numbers = [number for number in ENDING if not _stays_ignored(number)]
        for number in self._numbers:
            signal.signal(number, lambda *_: None)
        Thread(target=self._watch, name=WATCHER, daemon=True).start()

    def ignore(self) -> None:
        """Ignore further signals: the end is under way."""
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)

    def _watch(self) -> None:
        with suppress(OSError):  # as `ps -L` and `Withheld` know it
            Path('/proc/thread-self/comm').write_text(WATCHER)
        # another signal, that somebody else handles, writes its number, too
        while not set(self._wait.recv(4096)) & set(self._numbers):
            pass
        self.asked.set_result(None)
        while self._wait.recv(4096):  # so that what it had to wait for can still be read
            pass


def _stays_ignored(number: signal.Signals) -> bool:
    """Tell whether a node outlives a signal: that of a closed terminal below ``nohup``."""
    return number == signal.SIGHUP and signal.getsignal(number) == signal.SIG_IGN
