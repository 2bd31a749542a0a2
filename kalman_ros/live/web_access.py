# SPDX-License-Identifier: Apache-2.0
"""Access rules of a page: a known host, the origin of the page, and a token."""

from __future__ import annotations

import os
import socket
from dataclasses import dataclass, field
from hmac import compare_digest
from ipaddress import ip_address
from re import fullmatch
from urllib.parse import parse_qs, urlsplit

#: Names of the loopback interface of this machine.
_LOOPBACK = ('127.0.0.1', 'localhost')


@dataclass(frozen=True)
class Access:
    """The access rules of a server.

    A page of another site can make the user's browser send requests to this machine, but it can
    choose neither their ``Origin`` nor, with a host name that it resolves to this machine (DNS
    rebinding), their ``Host``. Therefore both are checked. On the loopback interface that
    suffices; on any other interface a token is required.

    Parameters
    ----------
    address
        Address on which the server listens.
    port
        Port on which the server listens.
    token
        Token that is required in a cookie; a request of the page with ``?token=`` sets the cookie.
        '' for no token.

    Raises
    ------
    ValueError
        If the address is not an IP address, if it is not on the loopback interface and there is no
        token, or if a cookie cannot contain the token.
    """

    address: str
    port: int
    token: str = ''
    _names: tuple[str, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        try:
            address = ip_address(self.address)
        except ValueError:
            raise ValueError(f"--listen: expected an IP address, got '{self.address}'") from None
        if not fullmatch('[A-Za-z0-9_-]*', self.token):
            raise ValueError('--token: expected letters, digits, - and _')
        if not address.is_loopback and not self.token:
            raise ValueError('--listen: an address beyond this machine needs a token')
        names = _LOOPBACK if address.is_loopback else (*_LOOPBACK, socket.gethostname())
        object.__setattr__(self, '_names', (self.address, *names))

    def check_port(self) -> None:
        """Raise ValueError if the server cannot listen; call this before a slow start."""
        family = socket.AF_INET6 if ':' in self.address else socket.AF_INET
        try:
            socket.create_server((self.address, self.port), family=family).close()
        except OSError as error:
            raise ValueError(self.unusable(error)) from None

    def unusable(self, error: OSError) -> str:
        """Return the reason for which the server cannot listen."""
        reason = os.strerror(error.errno or 0)
        return f'--port: {self.address}:{self.port} cannot be used: {reason}'

    @property
    def cookie(self) -> str:
        """Name of the cookie, which has the port, since all ports of a host share cookies."""
        return f'kalman_ros_{self.port}'

    @property
    def url(self) -> str:
        """Address of the page, with the token."""
        name = 'localhost' if ip_address(self.address).is_unspecified else self.address
        name = f'[{name}]' if ':' in name else name
        return f'http://{name}:{self.port}/{f"?token={self.token}" if self.token else ""}'

    def knows(self, host: str) -> bool:
        """Return whether a ``Host`` header names this server."""
        name, port = _split(host)
        if port != self.port:
            return False
        if name in self._names:
            return True
        # a server on all interfaces accepts any address, but no name, which any site may define
        return ip_address(self.address).is_unspecified and _is_address(name)

    def trusts(self, origin: str, host: str) -> bool:
        """Return whether the ``Origin`` of a request is the page of this server."""
        return self.knows(host) and origin == f'http://{host}'

    def admits(self, cookies: str) -> bool:
        """Return whether a ``Cookie`` header has the token, or no token is required."""
        if not self.token:
            return True
        pairs = (cookie.strip().partition('=') for cookie in cookies.split(';'))
        return any(name == self.cookie and self._matches(value) for name, _, value in pairs)

    def logs_in(self, query: str) -> bool:
        """Return whether the query of an address has the token."""
        tokens = parse_qs(query).get('token', [''])
        return bool(self.token) and self._matches(tokens[0])

    def _matches(self, token: str) -> bool:
        return compare_digest(token.encode(errors='replace'), self.token.encode())


def _split(host: str) -> tuple[str, int]:
    """Return the name and the port of a ``Host`` header; the port is 0 if it is malformed."""
    try:
        parts = urlsplit(f'//{host}')
        malformed = parts.path or parts.query or parts.fragment or '@' in host
        return ('', 0) if malformed else (parts.hostname or '', parts.port or 80)
    except ValueError:
        return '', 0


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
