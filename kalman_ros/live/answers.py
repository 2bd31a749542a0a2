# SPDX-License-Identifier: Apache-2.0
"""HTTP responses of the live page and of the gate for viewers: refusals, and files."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from http import HTTPStatus

from websockets.datastructures import Headers
from websockets.http11 import Response


def joined(headers: Headers, name: str, separator: str = ', ') -> str:
    """Return the values of a header, joined if it is repeated, so that none is overlooked."""
    return separator.join(headers.get_all(name))


def refusal(status: HTTPStatus, why: str) -> Response:
    """Return a refusal with its reason."""
    return response(status, f'{why}\n'.encode(), {'Content-Type': 'text/plain; charset=utf-8'})


def response(status: HTTPStatus, body: bytes, headers: Mapping[str, str]) -> Response:
    """Return a response that no other page may use or keep."""
    common = {
        'Content-Length': str(len(body)),
        'Connection': 'close',
        'Cache-Control': 'no-store',
        'X-Content-Type-Options': 'nosniff',
        'X-Frame-Options': 'DENY',
        'Referrer-Policy': 'no-referrer',
        'Cross-Origin-Resource-Policy': 'same-origin',
    }
    return Response(status.value, status.phrase, Headers({**headers, **common}), body)


def silent_logger(name: str) -> logging.Logger:
    """Return a logger that does not print requests that are not HTTP to the console."""
    logger = logging.getLogger(name)
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return logger
