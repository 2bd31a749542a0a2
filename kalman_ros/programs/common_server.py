# SPDX-License-Identifier: Apache-2.0
"""Command line arguments of the programs with a server."""

from __future__ import annotations

import argparse
import secrets

from kalman_ros.live.web_access import Access


def add_server(parser: argparse.ArgumentParser, port: int, server: str, client: str) -> None:
    """Add the options of a ``server``: address, port, and the token that a ``client`` needs."""
    parser.add_argument(
        '--port',
        type=int,
        default=port,
        metavar='N',
        help=f'of the {server} (default: %(default)s)',
    )
    parser.add_argument(
        '--listen', default='127.0.0.1', metavar='ADDRESS',
        help='also for other machines: an address of this one, or 0.0.0.0 for all',
    )  # fmt: skip
    parser.add_argument(
        '--token', default='', help=f'that --listen requires of a {client} (default: a random one)'
    )


def access(options: argparse.Namespace) -> Access:
    """Return address, port and token of the server; raise ValueError if the port is wrong."""
    if not 1 <= options.port <= 65535:
        raise ValueError(f'--port: expected 1 to 65535, got {options.port}')
    token = options.token
    if options.listen != '127.0.0.1' and not token:
        token = secrets.token_urlsafe(16)
    return Access(options.listen, options.port, token)
