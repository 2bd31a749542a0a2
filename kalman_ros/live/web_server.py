# SPDX-License-Identifier: Apache-2.0
"""Server of the live page: its files, and a socket for each tab."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from time import monotonic

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from .answers import joined, refusal, response, silent_logger
from .board import Board, Cursor
from .page_command import Command, read_command
from .threaded_server import ThreadedServer
from .web_access import Access

#: Largest number of tabs, size of a command in bytes, and number of commands per second of a tab.
_TABS, _LONGEST, _COMMANDS = 32, 4096, 200
#: Least interval in seconds of messages to a tab, and time limit in seconds for a tab to read a
#: message or to answer a ping.
_PERIOD, _PATIENCE = 0.02, 10.0
#: Folder of the page, and types of its files.
_PAGE = Path(__file__).with_name('page')
_TYPES = {'.html': 'text/html', '.css': 'text/css', '.js': 'text/javascript'}
#: Path of the socket.
_SOCKET = '/socket'


class WebServer(ThreadedServer):
    """A server that shows a board in tabs and passes on their commands, in a separate thread.

    Parameters
    ----------
    board
        Board that the tabs show.
    command
        Receives each command and the monotonic time of its arrival.
    access
        Address, port and access rules.
    """

    def __init__(
        self, board: Board, command: Callable[[Command, float], None], access: Access
    ) -> None:
        super().__init__(access)
        self._board, self._command = board, command
        self._files = {f'/{path.name}': path for path in _PAGE.iterdir()}
        self._tabs: set[asyncio.Event] = set()

    @property
    def tabs(self) -> int:
        """Number of connected tabs."""
        return len(self._tabs)

    async def listen(self, address: str, port: int) -> Server:
        """Serve the page, and notify its tabs of every change of the board."""
        server = await serve(
            self._tab, address, port, process_request=self._respond, compression=None,
            max_size=_LONGEST, max_queue=16, open_timeout=5.0, close_timeout=1.0,
            ping_interval=_PATIENCE, ping_timeout=_PATIENCE,
            server_header=None, logger=silent_logger(__name__),
        )  # fmt: skip
        self._board.on_change = lambda: self.call(self._wake)
        return server

    async def end(self, server: Server) -> None:
        """Close the server and the connections of the tabs."""
        server.close()
        await server.wait_closed()

    def _wake(self) -> None:
        for tab in self._tabs:
            tab.set()

    def _respond(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a file or a refusal; None opens a socket."""
        access = self._access
        # repeated headers are joined, so that they match nothing
        host, origin = (joined(request.headers, name) for name in ('Host', 'Origin'))
        path, _, query = request.path.partition('?')
        if not access.knows(host):
            return refusal(HTTPStatus.MISDIRECTED_REQUEST, 'this server has another name')
        if origin and not access.trusts(origin, host):
            return refusal(HTTPStatus.FORBIDDEN, 'the request is from another page')
        if access.logs_in(query):
            cookie = f'{access.cookie}={access.token}; HttpOnly; SameSite=Strict; Path=/'
            return response(HTTPStatus.SEE_OTHER, b'', {'Location': '/', 'Set-Cookie': cookie})
        if not access.admits(joined(request.headers, 'Cookie', '; ')):
            return refusal(HTTPStatus.UNAUTHORIZED, 'open the address with its token')
        if path == _SOCKET:
            if not origin:
                return refusal(HTTPStatus.FORBIDDEN, 'the request is from another page')
            full = len(self._tabs) >= _TABS
            return refusal(HTTPStatus.SERVICE_UNAVAILABLE, 'too many tabs') if full else None
        return self._file(path, host)

    def _file(self, path: str, host: str) -> Response:
        file = self._files.get('/live.html' if path == '/' else path)
        if file is None:
            return refusal(HTTPStatus.NOT_FOUND, 'there is no such page')
        kind = f'{_TYPES[file.suffix]}; charset=utf-8'
        policy = (
            f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
            f"connect-src ws://{host}; base-uri 'none'; form-action 'none'; "
            f"frame-ancestors 'none'"
        )
        headers = {'Content-Type': kind, 'Content-Security-Policy': policy}
        return response(HTTPStatus.OK, file.read_bytes(), headers)

    async def _tab(self, connection: ServerConnection) -> None:
        """Serve one tab until it closes."""
        news = asyncio.Event()
        self._tabs.add(news)
        self._board.readers = len(self._tabs)
        sending = asyncio.create_task(self._send(connection, news))
        try:
            await self._receive(connection)
        except ConnectionClosed:
            pass
        finally:
            sending.cancel()
            self._tabs.discard(news)
            self._board.readers = len(self._tabs)

    async def _send(self, connection: ServerConnection, news: asyncio.Event) -> None:
        """Send changes of the board, as fast as the tab reads them."""
        cursor = Cursor()
        try:
            while True:
                for text in self._board.news(cursor):
                    await asyncio.wait_for(connection.send(text), _PATIENCE)
                await asyncio.sleep(_PERIOD)
                await news.wait()
                news.clear()
        except ConnectionClosed:
            return
        except asyncio.TimeoutError:  # the tab does not read, so its place is freed
            connection.transport.abort()

    async def _receive(self, connection: ServerConnection) -> None:
        """Pass on the commands of a tab; close the connection if their rate is too high."""
        start, count = monotonic(), 0
        async for text in connection:
            now = monotonic()
            start, count = (now, 0) if now - start > 1.0 else (start, count + 1)
            if count > _COMMANDS:
                await connection.close(1008, 'too many commands')
                return
            command = read_command(text)
            if command is not None:
                self._command(command, now)
