# SPDX-License-Identifier: Apache-2.0
"""Reading of parts of recordings, compressed or not, and never more than they announce."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from .budget import Budget

#: Bytes of a piece, after which a signal is handled.
_PIECE = 1 << 22

MISSING = 'rosbags is not installed: python3 -m pip install rosbags'


def _lz4() -> Any:
    return import_module('lz4.frame').LZ4FrameDecompressor()


def _zstd() -> Any:
    try:
        return import_module('compression.zstd').ZstdDecompressor()  # Python 3.14
    except ModuleNotFoundError:
        return import_module('backports.zstd').ZstdDecompressor()


_KINDS: dict[str, Callable[[], Any]] = {'lz4': _lz4, 'zstd': _zstd, 'bz2': bz2.BZ2Decompressor}


class Part(NamedTuple):
    """Bytes at a place of a file, their number, and the kind and size of their content."""

    at: int
    stored: int
    kind: str
    size: int

    def read(self, path: Path, budget: Budget) -> bytes:
        """Return the content; ValueError as for `expand`, or if the budget does not suffice."""
        budget.expand(self.stored, self.size)
        with path.open('rb') as file:
            file.seek(self.at)
            return expand(file.read(self.stored), self.kind, self.size)


def expand(data: bytes, kind: str, size: int) -> bytes:
    """Return the ``size`` bytes compressed to ``data``; '' and 'none' mean no compression.

    Raises
    ------
    ValueError
        If the content has another size, or the kind is not known.
    """
    if kind in ('', 'none'):
        content = data
    elif kind in _KINDS:
        try:
            decompressor = _KINDS[kind]()
        except ModuleNotFoundError:
            raise ValueError(f'it is compressed by {kind}, and {MISSING}') from None
        try:
            content = _decompressed(decompressor, data, size + 1)
        except Exception as error:  # each library has errors of another kind
            raise ValueError(f'a block is not {kind}: {error}') from None
    else:
        raise ValueError(f"compression: expected {', '.join(_KINDS)}, got '{kind[:20]}'")
    if len(content) != size:
        raise ValueError(f'a block has {len(content)} bytes, expected {size}')
    return content


def _decompressed(decompressor: Any, data: bytes, most: int) -> bytes:
    """Return the first ``most`` bytes that were compressed to ``data``, in pieces."""
    content = BytesIO()
    while not decompressor.eof and (left := most - content.tell()):
        piece = decompressor.decompress(data, max_length=min(left, _PIECE))
        content.write(piece)
        data = b''
        if not piece and decompressor.needs_input:
            break
    return content.getvalue()
