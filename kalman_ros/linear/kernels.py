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


def corrected_moments(
    x: Array, P: Array, H: Array, R: Array, innovation: Array
) -> tuple[Array, Array, Array, Array, Any]:
    """Return x + K innovation and (I - K H) P (I - K H)' + K R K', with K, S and the NIS.

    K = P H' S^-1 and S = H P H' + R, for any leading axes. A NIS of None is still to be computed.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a single S is not positive definite; of several, its results are NaN.
    """
    k = kernels(x)
    H, R = k.ordered(H, R)
    K, S = k.gain(P, H, R)
    return k.corrected(x, K, innovation), k.joseph(K, H, P, R), K, S, None
