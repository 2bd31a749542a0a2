# SPDX-License-Identifier: Apache-2.0
"""What compressed parts of recordings contain, never more than they announce."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from importlib import import_module
from typing import Any

from .blocks import MOST_BLOCK

MISSING = 'rosbags is not installed: python3 -m pip install rosbags'


def _lz4() -> Any:
    return import_module('lz4.frame').LZ4FrameDecompressor()


def _zstd() -> Any:
    try:
        return import_module('compression.zstd').ZstdDecompressor()  # Python 3.14
    except ModuleNotFoundError:
        return import_module('backports.zstd').ZstdDecompressor()


_KINDS: dict[str, Callable[[], Any]] = {'lz4': _lz4, 'zstd': _zstd, 'bz2': bz2.BZ2Decompressor}


def expand(data: bytes, kind: str, size: int) -> bytes:
    """Return the ``size`` bytes that were compressed to ``data``; '' and 'none' are no kinds.

    Raises
    ------
    ValueError
        If it is another size, or larger than a block may be, or the kind is not known.
    """
    if size > MOST_BLOCK:
        raise ValueError(f'a block of {size} bytes, more than {MOST_BLOCK}')
    if kind in ('', 'none'):
        found = data
    elif kind in _KINDS:
        try:
            decompressor = _KINDS[kind]()
        except ModuleNotFoundError:
            raise ValueError(f'it is compressed by {kind}, and {MISSING}') from None
        try:
            found = decompressor.decompress(data, max_length=size + 1)
        except Exception as error:  # each library has errors of another kind
            raise ValueError(f'a block is not {kind}: {error}') from None
    else:
        raise ValueError(f"compression: expected {', '.join(_KINDS)}, got '{kind[:20]}'")
    if len(found) != size:
        raise ValueError(f'a block has {len(found)} bytes, expected {size}')
    return bytes(found)
