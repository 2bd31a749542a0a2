# SPDX-License-Identifier: Apache-2.0
"""Signals that end a process: recorded at any moment, and handled within milliseconds."""

from __future__ import annotations

import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path
from threading import Thread

from rclpy.task import Future

#: Ctrl-C, a launcher's request, a closed terminal, Ctrl-\, and what else ends a process that does
#: not handle it.
ENDING = (
    signal.SIGINT,
    signal.SIGTERM,
    signal.SIGHUP,
    signal.SIGQUIT,
    signal.SIGUSR1,
    signal.SIGUSR2,
    signal.SIGALRM,
)
#: The name of the thread that waits for them.
WATCHER = 'signals'


class Interruption:
    """Completes a future as soon as a signal requests the end.

    Python runs its handlers between two instructions of the main thread, which may be waiting in
    an executor. So a second thread waits for the byte that the interpreter writes at once, and
    completes the future, which wakes an executor that spins until it is done. A handler must not
    do that: the interrupted code may hold the future's lock.
    """

    def __init__(self) -> None:
        self.asked = Future()
        self._deferred = False
        self._wait, self._wake = socket.socketpair()
        self._wake.setblocking(False)
        signal.set_wakeup_fd(self._wake.fileno(), warn_on_full_buffer=False)
        self._numbers = [number for number in ENDING if not _is_ignored(number)]
        for number in self._numbers:
            signal.signal(number, self._on_signal)
        Thread(target=self._watch, name=WATCHER, daemon=True).start()

    def defer(self) -> None:
        """Leave it to the caller to end the process from now on, when the future is done.

        Until then, a signal ends it at once: it may be waiting for a parameter file.
        """
        self._deferred = True
        if self.asked.done():
            sys.exit()

    def _on_signal(self, *_: object) -> None:
        if not self._deferred:
            self.ignore()
            sys.exit()

    def ignore(self) -> None:
        """Ignore further signals: the process is ending."""
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)

    def _watch(self) -> None:
        with suppress(OSError):  # the name in `ps -L`, used by `Withheld`
            Path('/proc/thread-self/comm').write_text(WATCHER)
        # another signal, handled elsewhere, writes its number, too
        while not set(self._wait.recv(4096)) & set(self._numbers):
            pass
        self.asked.set_result(None)
        while self._wait.recv(4096):  # drain the pipe, so that writers never block
            pass


def _is_ignored(number: signal.Signals) -> bool:
    """Return whether a signal is ignored: that of a closed terminal under ``nohup``."""
    return number == signal.SIGHUP and signal.getsignal(number) == signal.SIG_IGN
