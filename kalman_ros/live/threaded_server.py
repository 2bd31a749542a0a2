# SPDX-License-Identifier: Apache-2.0
"""Base of asyncio servers in a separate thread."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from typing import Any

from .web_access import Access

#: Time limit in seconds for the end of the thread.
_PATIENCE = 5.0


class ThreadedServer(ABC):
    """A server that listens while its context is entered.

    Parameters
    ----------
    access
        Address, port and access rules.
    """

    def __init__(self, access: Access) -> None:
        self._access = access
        self._started, self._error = Event(), ''
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop_request = asyncio.Event()
        self._thread = Thread(target=lambda: asyncio.run(self._run()), daemon=True)

    def __enter__(self) -> Any:
        self._thread.start()
        self._started.wait()
        if self._error:
            raise ValueError(self._error)
        return self

    def __exit__(self, *_: object) -> None:
        self.call(self._stop_request.set)
        self._thread.join(_PATIENCE)

    def call(self, function: Callable[[], object]) -> None:
        """Schedule a function call in the thread of the server; callable from any thread."""
        if self._loop is not None:
            with suppress(RuntimeError):  # the thread has ended
                self._loop.call_soon_threadsafe(function)

    @abstractmethod
    async def listen(self, address: str, port: int) -> Any:
        """Return a listening asyncio server; raise OSError if the port cannot be used."""

    async def _run(self) -> None:
        self._loop = asyncio.get_running_loop()
        address, port = self._access.address, self._access.port
        try:
            server = await self.listen(address, port)
        except OSError as error:
            self._error = self._access.unusable(error)
            self._started.set()
            return
        self._started.set()
        await self._stop_request.wait()
        await self.end(server)

    async def end(self, server: Any) -> None:
        """Close the server."""
        server.close()
