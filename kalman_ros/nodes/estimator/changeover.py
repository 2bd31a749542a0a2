# SPDX-License-Identifier: Apache-2.0
"""Compiles models and sensors beside the work of a node, which changes over to them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Thread, get_native_id

from kalman_ros.compiled.library import CompilerError, load
from kalman_ros.nodes.middleware.host import Host

#: How often a node looks whether all is compiled, in seconds.
_PERIOD = 0.1
#: How nice a compiler is to the node.
_NICE = 10


class Changeover:
    """Waits for a C compiler without keeping a node from its work.

    Parameters
    ----------
    node
        That is being configured.
    change
        Called by the node's executor when all is compiled, or cannot be.
    """

    def __init__(self, node: Host, change: Callable[[], object]) -> None:
        self._change = change
        self._threads: list[Thread] = []
        self._timer = node.create_timer(_PERIOD, self._look, clock=node.steady)
        self._timer.cancel()

    def when_compiled(self, sources: Sequence[str]) -> None:
        """Have sources compiled, and change over then; without any, nothing happens."""
        if sources:
            self._threads.append(Thread(target=_compile, args=(sources,), daemon=True))
            self._threads[-1].start()
            self._timer.reset()

    def _look(self) -> None:
        if not any(thread.is_alive() for thread in self._threads):
            self._threads.clear()
            self._timer.cancel()
            self._change()


def _compile(sources: Sequence[str]) -> None:
    for source in sources:
        with suppress(AttributeError, OSError):  # not before the work of the node
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            os.setpriority(os.PRIO_PROCESS, get_native_id(), _NICE)
        with suppress(CompilerError):  # which the next attempt reports
            load(source)
