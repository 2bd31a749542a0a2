# SPDX-License-Identifier: Apache-2.0
"""Access control, by host, page and token, for a server of viewers that has none."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from http import HTTPStatus
from urllib.parse import urlsplit

from .threaded_server import ThreadedServer
from .web_access import Access

#: Origins of the pages of viewers; a program sends no origin. The origin of a desktop application
#: may be that of a local file, as of any saved page, so it is admitted only on request.
PAGES = ('https://app.foxglove.dev',)
#: Name of the protocol on the server, and its name in older viewers.
_PROTOCOL, _OLD = 'foxglove.sdk.v1', 'foxglove.websocket.v1'
#: Largest size of a request in bytes, its time limit in seconds, and block size in bytes.
_LONGEST, _PATIENCE, _BLOCK = 16_384, 5.0, 65_536
#: Largest numbers of viewers, and of connections that have not yet sent a request.
_MOST_VIEWERS, _MOST_PENDING = 32, 128
_END = b'\r\n\r\n'


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
        self._viewers = 0
        # in the order in which they connected
        self._pending: dict[asyncio.StreamWriter, None] = {}

    async def listen(self, address: str, port: int) -> asyncio.Server:
        """Listen for viewers."""
        return await asyncio.start_server(self._serve, address, port, limit=_LONGEST)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection until either end closes it."""
        try:
            path, headers = await self._read_request(reader, writer)
            refusal = self._refusal(path, headers)
            if refusal:
                self._on_refusal(refusal[1])
                writer.write(_response(*refusal))
                await writer.drain()
            else:
                self._viewers += 1
                try:
                    await self._connect(headers, reader, writer)
                finally:
                    self._viewers -= 1
        except (OSError, ValueError, asyncio.IncompleteReadError, asyncio.LimitOverrunError,
                asyncio.TimeoutError):  # fmt: skip
            pass  # a port scanner, or a broken connection
        finally:
            writer.close()

    async def _read_request(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> tuple[str, dict[str, str]]:
        """Return the path and headers of a request; drop the oldest if too many are pending."""
        self._pending[writer] = None
        if len(self._pending) > _MOST_PENDING:
            next(iter(self._pending)).transport.abort()
        try:
            return _parse_request(await asyncio.wait_for(reader.readuntil(_END), _PATIENCE))
        finally:
            del self._pending[writer]

    def _refusal(self, path: str, headers: Mapping[str, str]) -> tuple[HTTPStatus, str] | None:
        """Return the status and reason of a refusal; None if the request is admitted."""
        origin = headers.get('origin', '')
        if not self._access.knows(headers.get('host', '')):
            return HTTPStatus.MISDIRECTED_REQUEST, 'a request to another name than this server has'
        if origin and origin not in self._pages:
            shown = ''.join(character for character in origin if character.isprintable())[:80]
            return HTTPStatus.FORBIDDEN, f'a page of {shown} (--page {shown} admits it)'
        if self._access.token and not self._access.logs_in(urlsplit(path).query):
            return HTTPStatus.UNAUTHORIZED, 'a viewer without the token in its address'
        if headers.get('upgrade', '').lower() != 'websocket':
            return HTTPStatus.UPGRADE_REQUIRED, 'a browser: open this address in a viewer'
        if not {_PROTOCOL, _OLD}.intersection(_protocols(headers)):
            return HTTPStatus.BAD_REQUEST, f'a client that does not speak {_PROTOCOL}'
        if self._viewers >= _MOST_VIEWERS:
            return HTTPStatus.SERVICE_UNAVAILABLE, f'more than {_MOST_VIEWERS} viewers'
        return None

    async def _connect(
        self,
        headers: Mapping[str, str],
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        """Pass on the request of a viewer, and then all data in both directions."""
        server_reader, server_writer = await asyncio.open_connection(*self._server, limit=_LONGEST)
        try:
            server_writer.write(
                f'GET / HTTP/1.1\r\nHost: {self._server[0]}:{self._server[1]}\r\n'
                f'Upgrade: websocket\r\nConnection: Upgrade\r\n'
                f'Sec-WebSocket-Key: {headers.get("sec-websocket-key", "")}\r\n'
                f'Sec-WebSocket-Version: {headers.get("sec-websocket-version", "")}\r\n'
                f'Sec-WebSocket-Protocol: {_PROTOCOL}\r\n\r\n'.encode()
            )
            head = await asyncio.wait_for(server_reader.readuntil(_END), _PATIENCE)
            if _PROTOCOL not in _protocols(headers):
                head = head.replace(_PROTOCOL.encode(), _OLD.encode())
            writer.write(head)
            if not head.startswith(b'HTTP/1.1 101 '):  # refused: no socket data follows
                await writer.drain()
                return
            directions = [
                asyncio.ensure_future(_forward(reader, server_writer)),
                asyncio.ensure_future(_forward(server_reader, writer)),
            ]
            try:
                await asyncio.wait(directions, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for direction in directions:
                    direction.cancel()
                await asyncio.gather(*directions, return_exceptions=True)
        finally:
            server_writer.close()


async def _forward(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Write all data that is read until the end of the stream."""
    while data := await reader.read(_BLOCK):
        writer.write(data)
        await writer.drain()


def _parse_request(head: bytes) -> tuple[str, dict[str, str]]:
    """Return the path and the headers of a request; raise ValueError if it is malformed.

    Headers with the same name are joined, so that no value is overlooked.
    """
    first, *lines = head[: -len(_END)].decode('ascii').split('\r\n')
    method, path, version = first.split(' ')
    if (method, version) != ('GET', 'HTTP/1.1'):
        raise ValueError(f'expected GET and HTTP/1.1, got {first}')
    headers: dict[str, str] = {}
    for line in lines:
        name, colon, value = line.partition(':')
        if not colon or not line.isprintable() or name != name.strip():
            raise ValueError(f'expected a header, got {line}')
        previous = headers.get(name.lower())
        value = value.strip()
        headers[name.lower()] = value if previous is None else f'{previous}, {value}'
    return path, headers


def _protocols(headers: Mapping[str, str]) -> list[str]:
    return [protocol.strip() for protocol in headers.get('sec-websocket-protocol', '').split(',')]


def _response(status: HTTPStatus, why: str) -> bytes:
    body = f'refused: {why}\n'.encode()
    return (
        f'HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: text/plain; charset=utf-8\r\n'
        f'Content-Length: {len(body)}\r\nConnection: close\r\nCache-Control: no-store\r\n\r\n'
    ).encode() + body
