# SPDX-License-Identifier: Apache-2.0
"""Command line arguments of the programs with a server."""

from __future__ import annotations

import argparse
import secrets

from kalman_ros.live.web_access import Access


def add_server(parser: argparse.ArgumentParser, port: int, what: str, who: str) -> None:
    """Add the options of a server: what has the default ``port``, and who needs the token."""
    parser.add_argument(
        '--port', type=int, default=port, metavar='N', help=f'of the {what} (default: %(default)s)'
    )
    parser.add_argument(
        '--listen', default='127.0.0.1', metavar='ADDRESS',
        help='also for other machines: an address of this one, or 0.0.0.0 for all',
    )  # fmt: skip
    parser.add_argument(
        '--token', default='', help=f'that --listen requires of a {who} (default: a random one)'
    )


def access(options: argparse.Namespace) -> Access:
    """Return who may use the server; ValueError if an option is wrong."""
    if not 1 <= options.port <= 65535:
        raise ValueError(f'--port: expected 1 to 65535, got {options.port}')
    token = options.token
    if options.listen != '127.0.0.1' and not token:
        token = secrets.token_urlsafe(16)
    return Access(options.listen, options.port, token)
