# SPDX-License-Identifier: Apache-2.0
"""Signals deferred until the executor has returned.

An exception raised by a signal while the executor runs a callback is lost in it, or leaves it
half destroyed. So signals are only recorded meanwhile, and delivered afterwards.
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
    """Defer signals that end the process within the block; yield the list of them."""
    noted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return

    def note(number: int, _: FrameType | None) -> None:
        # nothing more: the interrupted code may hold any lock
        noted.append(number)

    handlers: dict[signal.Signals, Any] = {s: signal.signal(s, note) for s in _SIGNALS}
    try:
        yield noted
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if noted:
        signal.raise_signal(noted[0])
