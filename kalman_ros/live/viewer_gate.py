# SPDX-License-Identifier: Apache-2.0
"""Admits viewers to a server that checks nothing itself: by host, page and token."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from http import HTTPStatus
from urllib.parse import urlsplit

from .threaded_server import ThreadedServer
from .web_access import Access

#: The pages of viewers; a program sends no origin. A desktop application may be a page in a file,
#: and so may whatever a person has saved and opened: that is not admitted without being asked for.
PAGES = ('https://app.foxglove.dev',)
#: What the server calls the protocol, and what older viewers call the same.
_PROTOCOL, _OLD = 'foxglove.sdk.v1', 'foxglove.websocket.v1'
#: The most bytes of a request, seconds that it may take, and bytes that are passed on at once.
_LONGEST, _PATIENCE, _BLOCK = 16_384, 5.0, 65_536
#: The most viewers, and the most connections that have not yet shown that they are one.
_VIEWERS, _STRANGERS = 32, 128
_END = b'\r\n\r\n'


class ViewerGate(ThreadedServer):
    """Listens for viewers and connects those that may to a server, in a separate thread.

    A page elsewhere can make a person's browser connect here. It can neither choose its
    ``Origin`` nor, with a name that it points at this machine, its ``Host``, so both are checked
    before the server receives anything, and the request that it receives is composed by the gate.

    Parameters
    ----------
    access
        Address, port, and the token that the address of a viewer must have, if any.
    server
        Address and port of the server.
    pages
        The origins that are admitted beside `PAGES`.
    on_refusal
        Called with each reason for which a viewer was refused.
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
        # in the order of their arrival
        self._strangers: dict[asyncio.StreamWriter, None] = {}

    async def listen(self, address: str, port: int) -> asyncio.Server:
        """Listen for viewers."""
        return await asyncio.start_server(self._serve, address, port, limit=_LONGEST)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection until an end closes it."""
        try:
            path, headers = await self._request(reader, writer)
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
            pass  # a port scanner, or a connection that broke
        finally:
            writer.close()

    async def _request(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> tuple[str, dict[str, str]]:
        """Return a request's path and headers; where too many wait, the oldest is dropped."""
        self._strangers[writer] = None
        if len(self._strangers) > _STRANGERS:
            next(iter(self._strangers)).transport.abort()
        try:
            return _parsed(await asyncio.wait_for(reader.readuntil(_END), _PATIENCE))
        finally:
            del self._strangers[writer]

    def _refusal(self, path: str, headers: Mapping[str, str]) -> tuple[HTTPStatus, str] | None:
        """Return why a request is refused; None if it is not."""
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
        if self._viewers >= _VIEWERS:
            return HTTPStatus.SERVICE_UNAVAILABLE, f'more than {_VIEWERS} viewers'
        return None

    async def _connect(
        self,
        headers: Mapping[str, str],
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        """Pass on the request of a viewer, and then everything both ways."""
        own_reader, own_writer = await asyncio.open_connection(*self._server, limit=_LONGEST)
        try:
            own_writer.write(
                f'GET / HTTP/1.1\r\nHost: {self._server[0]}:{self._server[1]}\r\n'
                f'Upgrade: websocket\r\nConnection: Upgrade\r\n'
                f'Sec-WebSocket-Key: {headers.get("sec-websocket-key", "")}\r\n'
                f'Sec-WebSocket-Version: {headers.get("sec-websocket-version", "")}\r\n'
                f'Sec-WebSocket-Protocol: {_PROTOCOL}\r\n\r\n'.encode()
            )
            head = await asyncio.wait_for(own_reader.readuntil(_END), _PATIENCE)
            if _PROTOCOL not in _protocols(headers):
                head = head.replace(_PROTOCOL.encode(), _OLD.encode())
            writer.write(head)
            if not head.startswith(b'HTTP/1.1 101 '):  # then what follows is no longer a socket's
                await writer.drain()
                return
            ways = [
                asyncio.ensure_future(_pass_on(reader, own_writer)),
                asyncio.ensure_future(_pass_on(own_reader, writer)),
            ]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
        finally:
            own_writer.close()


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Write what is read until the end."""
    while data := await reader.read(_BLOCK):
        writer.write(data)
        await writer.drain()


def _parsed(head: bytes) -> tuple[str, dict[str, str]]:
    """Return the path and the headers of a request; ValueError if it is malformed.

    Headers of one name are joined, so that none of the values is overlooked.
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
        known = headers.get(name.lower())
        value = value.strip()
        headers[name.lower()] = value if known is None else f'{known}, {value}'
    return path, headers


def _protocols(headers: Mapping[str, str]) -> list[str]:
    return [each.strip() for each in headers.get('sec-websocket-protocol', '').split(',')]


def _response(status: HTTPStatus, why: str) -> bytes:
    body = f'refused: {why}\n'.encode()
    return (
        f'HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: text/plain; charset=utf-8\r\n'
        f'Content-Length: {len(body)}\r\nConnection: close\r\nCache-Control: no-store\r\n\r\n'
    ).encode() + body
