# SPDX-License-Identifier: Apache-2.0
"""Computes the theory of a live page in a process beside it: always of the newest parameters.

A thread would keep the interpreter from the topics for half a second at a time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from .adjustments import Adjustments
from .live_theory import theory

#: Added to the niceness of the process: the nodes come first.
_NICE = 10


class TheoryWorker:
    """A process that computes `theory` on request, of the newest request; a context manager.

    Parameters
    ----------
    deliver
        Called with each result, in a thread of the worker.
    """

    def __init__(self, deliver: Callable[[dict[str, Any]], None]) -> None:
        self._deliver = deliver
        self._lock = Lock()
        self._waiting = ''
        self._busy = False

    def __enter__(self) -> TheoryWorker:
        self._process = subprocess.Popen(
            [sys.executable, '-m', __name__],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            start_new_session=True,
        )  # fmt: skip
        Thread(target=self._receive, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()

    def request(self, adjustments: Adjustments) -> None:
        """Ask for the theory of the parameters of now."""
        wanted = {
            'file': str(adjustments.file),
            'shared': adjustments.shared,
            'changes': adjustments.changes,
        }
        with self._lock:
            self._waiting = json.dumps(wanted)
            if not self._busy:
                self._send()

    def _send(self) -> None:
        """Pass the newest request on; the caller holds the lock."""
        text, self._waiting = self._waiting, ''
        self._busy = bool(text)
        assert self._process.stdin is not None
        try:
            if text:
                self._process.stdin.write(f'{text}\n')
                self._process.stdin.flush()
        except OSError:  # it has ended
            self._busy = True

    def _receive(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._deliver(json.loads(line))
            with self._lock:
                self._send()


def _answer(wanted: dict[str, Any]) -> dict[str, Any]:
    found = Adjustments(Path(wanted['file']), wanted['shared'])
    for node, values in wanted['changes'].items():
        found.change(node, values, tried=True)
    actual, estimator = found.scenario('plant'), found.scenario('estimator')
    believed = found.believed() if found.driven else estimator
    delay = found.value('plant', 'actuator_delay')
    return theory(believed, actual, found.filter_options(), delay)


def main() -> None:
    """Answer requests, a line each, until there are no more."""
    os.nice(_NICE)
    for line in sys.stdin:
        try:
            answer = _answer(json.loads(line))
        except (ValueError, ArithmeticError) as error:
            answer = {'notes': [str(error)]}
        print(json.dumps(answer), flush=True)


if __name__ == '__main__':
    main()
