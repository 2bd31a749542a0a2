# SPDX-License-Identifier: Apache-2.0
"""Deferral of signals until the executor has returned.

An exception that a signal raises while the executor runs a callback is lost, or leaves the
executor partly destroyed. Therefore signals are recorded meanwhile, and delivered afterwards.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


@contextmanager
def deferred() -> Iterator[list[int]]:
    """Defer signals that end the process within the block; yield the list of such signals."""
    pending: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield pending
        return

    def record(number: int, _: FrameType | None) -> None:
        # do nothing else, since the interrupted code may hold any lock
        pending.append(number)

    handlers: dict[signal.Signals, Any] = {s: signal.signal(s, record) for s in _SIGNALS}
    try:
        yield pending
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if pending:
        signal.raise_signal(pending[0])
