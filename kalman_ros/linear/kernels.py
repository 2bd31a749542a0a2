# SPDX-License-Identifier: Apache-2.0
"""The named products of which filters are written, for one belief or for any number at once."""

from __future__ import annotations

from typing import Any

from . import batched, single
from .matrices import Array


def kernels(x: Array) -> Any:
    """Return the products for states ``x``: of `single` if (n,), of `batched` if (..., n).

    Both modules have the same names, so that a filter is written once.
    """
    return single if x.ndim == 1 else batched
