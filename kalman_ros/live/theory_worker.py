# SPDX-License-Identifier: Apache-2.0
"""Computation of the theory of a live page, for the newest parameters, in a separate process.

A thread would delay the processing of topics by half a second at a time.
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

#: Increment of the niceness of the process, so that the nodes have priority.
_NICE = 10


class TheoryWorker:
    """A process that computes `theory` for the newest request; a context manager.

    Parameters
    ----------
    deliver
        Receives each result, in a thread of the worker.
    """

    def __init__(self, deliver: Callable[[dict[str, Any]], None]) -> None:
        self._deliver = deliver
        self._lock = Lock()
        self._waiting = ''
        self._busy = self._is_closed = False

    def __enter__(self) -> TheoryWorker:
        self._process = subprocess.Popen(
            [sys.executable, '-m', __name__],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            start_new_session=True,
        )  # fmt: skip
        Thread(target=self._receive, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closed = True
        self._process.terminate()
        self._process.wait()

    def request(self, adjustments: Adjustments, version: int) -> None:
        """Request the theory for the current parameters; the answer has their ``version``."""
        request = {
            'version': version,
            'file': str(adjustments.file),
            'shared': adjustments.shared,
            'changes': adjustments.changes,
        }
        with self._lock:
            self._waiting = json.dumps(request)
            if not self._busy:
                self._send()

    def _send(self) -> None:
        """Send the newest request; the caller must hold the lock."""
        text, self._waiting = self._waiting, ''
        self._busy = bool(text)
        assert self._process.stdin is not None
        try:
            if text:
                self._process.stdin.write(f'{text}\n')
                self._process.stdin.flush()
        except OSError:  # the process has ended
            self._busy = True

    def _receive(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._deliver(json.loads(line))
            with self._lock:
                self._send()
        if not self._is_closed:
            self._deliver({'notes': ['theory: its process has ended; restart the page']})


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    adjustments = Adjustments(Path(request['file']), request['shared'])
    for node, values in request['changes'].items():
        adjustments.change(node, values, tried=True)
    actual, estimator = adjustments.scenario('plant'), adjustments.scenario('estimator')
    believed = adjustments.believed() if adjustments.driven else estimator
    delay = adjustments.value('plant', 'actuator_delay')
    return theory(believed, actual, delay)


def main() -> None:
    """Answer requests from standard input, one per line, until its end."""
    os.nice(_NICE)
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = _answer(request)
        except (ValueError, ArithmeticError) as error:
            answer = {'notes': [str(error)]}
        print(json.dumps({**answer, 'version': request['version']}), flush=True)


if __name__ == '__main__':
    main()
