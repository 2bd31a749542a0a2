# SPDX-License-Identifier: Apache-2.0
"""Access control, by host, page and token, for a server of viewers that has none."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
from contextlib import suppress
from http import HTTPStatus

from websockets.asyncio.client import connect
from websockets.asyncio.connection import Connection
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from .answers import joined, refusal, silent_logger
from .threaded_server import ThreadedServer
from .web_access import Access

#: Origins of the pages of viewers; a program sends no origin. The origin of a desktop application
#: may be that of a local file, as of any saved page, so it is admitted only on request.
PAGES = ('https://app.foxglove.dev',)
#: Name of the protocol on the server, and its name in older viewers.
_PROTOCOL, _OLD = Subprotocol('foxglove.sdk.v1'), Subprotocol('foxglove.websocket.v1')
#: Largest number of viewers, and time limit of a request in seconds.
_MOST_VIEWERS, _PATIENCE = 32, 5.0
#: Seconds for the viewers to end their connections.
_CLOSING = 1.5
_LOGGER = silent_logger(__name__)
#: Largest message of a viewer in bytes.
_LONGEST = 1_048_576


class ViewerGate(ThreadedServer):
    """A server that connects admitted viewers to another server, in a separate thread.

    A page of another site can make the user's browser connect to this machine, but it can choose
    neither the ``Origin`` of the request nor, with a host name that it resolves to this machine,
    its ``Host``. Both are checked before the server receives anything, and the gate composes the
    request that the server receives.

    Parameters
    ----------
    access
        Address, port, and the token that the address of a viewer must contain, if any.
    server
        Address and port of the server.
    pages
        Origins that are admitted in addition to `PAGES`.
    on_refusal
        Receives the reason of each refusal of a viewer.
    """

    def __init__(
        self,
        access: Access,
        server: tuple[str, int],
        pages: Collection[str] = (),
        on_refusal: Callable[[str], None] = lambda _: None,
    ) -> None:
        super().__init__(access)
        self._server, self._on_refusal = server, on_refusal
        self._pages = {*PAGES, *pages}
        self._viewers: set[ServerConnection] = set()

    async def listen(self, address: str, port: int) -> Server:
        """Listen for viewers."""
        return await serve(
            self._serve, address, port, process_request=self._answer, compression=None,
            subprotocols=[_PROTOCOL, _OLD], max_size=_LONGEST, open_timeout=_PATIENCE,
            close_timeout=1.0, ping_timeout=None, server_header=None, logger=_LOGGER,
        )  # fmt: skip

    async def end(self, server: Server) -> None:
        """Close the server and the connections of the viewers; those that read nothing end."""
        server.close()
        for _ in range(2):
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(server.wait_closed(), _CLOSING)
            for viewer in self._viewers:
                viewer.transport.abort()

    def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """Return a refusal; None opens a socket."""
        refused = self._refusal(request)
        if refused is None:
            return None
        status, why = refused
        self._on_refusal(why)
        return refusal(status, f'refused: {why}')

    def _refusal(self, request: Request) -> tuple[HTTPStatus, str] | None:
        """Return the status and reason of a refusal; None if the request is admitted."""
        host, origin, upgrade, protocols = (
            joined(request.headers, name)
            for name in ('Host', 'Origin', 'Upgrade', 'Sec-WebSocket-Protocol')
        )
        if not self._access.knows(host):
            return HTTPStatus.MISDIRECTED_REQUEST, 'a request to another name than this server has'
        if origin and origin not in self._pages:
            shown = ''.join(character for character in origin if character.isprintable())[:80]
            return HTTPStatus.FORBIDDEN, f'a page of {shown} (--page {shown} admits it)'
        if self._access.token and not self._access.logs_in(request.path.partition('?')[2]):
            return HTTPStatus.UNAUTHORIZED, 'a viewer without the token in its address'
        if upgrade.lower() != 'websocket':
            return HTTPStatus.UPGRADE_REQUIRED, 'a browser: open this address in a viewer'
        if not {_PROTOCOL, _OLD}.intersection(map(str.strip, protocols.split(','))):
            return HTTPStatus.BAD_REQUEST, f'a client that does not speak {_PROTOCOL}'
        if len(self._viewers) >= _MOST_VIEWERS:
            return HTTPStatus.SERVICE_UNAVAILABLE, f'more than {_MOST_VIEWERS} viewers'
        return None

    async def _serve(self, viewer: ServerConnection) -> None:
        """Pass on all messages in both directions until either end closes."""
        host, port = self._server
        if len(self._viewers) >= _MOST_VIEWERS:  # others were faster
            await viewer.close(1013, f'more than {_MOST_VIEWERS} viewers')
            return
        self._viewers.add(viewer)
        try:
            async with connect(
                f'ws://{host}:{port}', subprotocols=[_PROTOCOL], compression=None, max_size=None,
                open_timeout=_PATIENCE, close_timeout=1.0, ping_interval=None, proxy=None,
                logger=_LOGGER,
            ) as server:  # fmt: skip
                directions = [
                    asyncio.ensure_future(_forward(viewer, server)),
                    asyncio.ensure_future(_forward(server, viewer)),
                ]
                try:
                    await asyncio.wait(directions, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    for direction in directions:
                        direction.cancel()
                    await asyncio.gather(*directions, return_exceptions=True)
        except (OSError, WebSocketException):
            await viewer.close(1011, 'the server of the topics does not answer')
        finally:
            self._viewers.remove(viewer)


async def _forward(source: Connection, target: Connection) -> None:
    """Send all messages that are received until either end closes."""
    with suppress(ConnectionClosed):
        async for message in source:
            await target.send(message)
