# SPDX-License-Identifier: Apache-2.0
"""Who may use the page: requests to a known host, from its own page, with its token."""

from __future__ import annotations

import os
import socket
from dataclasses import dataclass, field
from hmac import compare_digest
from ipaddress import ip_address
from re import fullmatch
from urllib.parse import parse_qs, urlsplit

#: The names of this machine's loopback interface.
_LOOPBACK = ('127.0.0.1', 'localhost')


@dataclass(frozen=True)
class Access:
    """The rules of a server.

    A page elsewhere can make a person's browser send requests here, but neither choose their
    ``Origin`` nor, with a name that it points at this machine (DNS rebinding), their ``Host``.
    So both are checked. On the loopback interface that is enough; elsewhere a token is required.

    Parameters
    ----------
    address
        That the server listens on.
    port
        The port.
    token
        Required in a cookie, which a request of the page with ``?token=`` sets; '' for none.

    Raises
    ------
    ValueError
        If the address is not an IP address, or not on the loopback and without a token; or if a
        cookie cannot hold the token.
    """

    address: str
    port: int
    token: str = ''
    _names: tuple[str, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        try:
            given = ip_address(self.address)
        except ValueError:
            raise ValueError(f"--listen: expected an IP address, got '{self.address}'") from None
        if not fullmatch('[A-Za-z0-9_-]*', self.token):
            raise ValueError('--token: expected letters, digits, - and _')
        if not given.is_loopback and not self.token:
            raise ValueError('--listen: an address beyond this machine needs a token')
        names = _LOOPBACK if given.is_loopback else (*_LOOPBACK, socket.gethostname())
        object.__setattr__(self, '_names', (self.address, *names))

    def check_port(self) -> None:
        """Raise ValueError if the server cannot listen, before what takes long is started."""
        family = socket.AF_INET6 if ':' in self.address else socket.AF_INET
        try:
            socket.create_server((self.address, self.port), family=family).close()
        except OSError as error:
            raise ValueError(self.unusable(error)) from None

    def unusable(self, error: OSError) -> str:
        """Return why the server cannot listen."""
        reason = os.strerror(error.errno or 0)
        return f'--port: {self.address}:{self.port} cannot be used: {reason}'

    @property
    def cookie(self) -> str:
        """The name of the cookie: cookies of all ports of a host are shared."""
        return f'kalman_ros_{self.port}'

    @property
    def url(self) -> str:
        """The address of the page, with the token."""
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
        # on all interfaces, by the address of any of them; a name could be anybody's
        return ip_address(self.address).is_unspecified and _is_address(name)

    def trusts(self, origin: str, host: str) -> bool:
        """Return whether a request is from this server's page: its ``Origin`` is the host's."""
        return self.knows(host) and origin == f'http://{host}'

    def admits(self, cookies: str) -> bool:
        """Return whether a ``Cookie`` header has the token, if one is required."""
        if not self.token:
            return True
        pairs = (each.strip().partition('=') for each in cookies.split(';'))
        return any(name == self.cookie and self._matches(value) for name, _, value in pairs)

    def logs_in(self, query: str) -> bool:
        """Return whether the query of an address has the token."""
        given = parse_qs(query).get('token', [''])
        return bool(self.token) and self._matches(given[0])

    def _matches(self, given: str) -> bool:
        return compare_digest(given.encode(errors='replace'), self.token.encode())


def _split(host: str) -> tuple[str, int]:
    """Return the name and the port of a ``Host`` header; the port is 0 if it is malformed."""
    try:
        parts = urlsplit(f'//{host}')
        strange = parts.path or parts.query or parts.fragment or '@' in host
        return ('', 0) if strange else (parts.hostname or '', parts.port or 80)
    except ValueError:
        return '', 0


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
