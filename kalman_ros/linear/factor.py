# SPDX-License-Identifier: Apache-2.0
"""Cholesky factors of covariances, with a repair that is small, bounded and counted."""

from __future__ import annotations

import numpy as np

from .lapack import dpotrf
from .matrices import Array, identity, is_finite

#: Added to the variances in turn, relative to the largest one, until there is a factor.
_REPAIRS = (1e-14, 1e-12, 1e-10, 1e-8)


def cholesky(P: Array) -> tuple[Array, Array, int]:
    """Factorise a symmetric positive semi-definite ``P`` (n, n).

    A coordinate that is certain, with a row of zeros, stays certain.

    Returns
    -------
    L
        Lower triangular (n, n).
    P
        L L' (n, n): the argument unless it had to be repaired.
    repairs
        The number of repairs, 0 or 1.

    Raises
    ------
    numpy.linalg.LinAlgError
        If P is not finite, or no repair of at most 1e-8 of the largest variance makes it
        positive definite.
    """
    if not is_finite(P):
        raise np.linalg.LinAlgError('the covariance is not finite')
    L, info = dpotrf(P, lower=1, clean=1)
    if info == 0:
        return L, P, 0
    variances = P.diagonal()
    largest = float(np.max(variances))
    if np.any(variances == 0.0) and not P[variances == 0.0].any():
        return _of_a_part(P, variances != 0.0)
    for size in _REPAIRS:
        repaired = P + size * largest * identity(len(P))
        L, info = dpotrf(repaired, lower=1, clean=1)
        if info == 0 and largest > 0.0:
            return L, repaired, 1
    raise np.linalg.LinAlgError('the covariance is not positive semi-definite')


def _of_a_part(P: Array, uncertain: Array) -> tuple[Array, Array, int]:
    """Factorise a ``P`` that is zero except for the ``uncertain`` coordinates (n,)."""
    L, whole, repairs = np.zeros_like(P), P, 0
    if uncertain.any():
        part = np.ix_(uncertain, uncertain)
        L[part], repaired, repairs = cholesky(P[part])
        if repairs:
            whole = P.copy()
            whole[part] = repaired
    return L, whole, repairs
