# SPDX-License-Identifier: Apache-2.0
"""The algebraic Riccati equations, with a reason where they have no stabilising solution."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

from kalman_ros.core import Array, DesignError, symmetric

from .structure import describe, uncontrollable_modes, unstable


def continuous(A: Array, B: Array, Q: Array, R: Array, N: Array) -> Array:
    """Return S of A'S + S A - (S B + N) R^-1 (B'S + N') + Q = 0.

    Raises
    ------
    DesignError
        If no stabilising solution exists.
    """
    try:
        return symmetric(np.asarray(solve_continuous_are(A, B, Q, R, s=N)))
    except np.linalg.LinAlgError:
        raise DesignError(_reason(A, B, sampled=False)) from None


def discrete(F: Array, G: Array, Q: Array, R: Array, N: Array) -> Array:
    """Return S of F'S F - S - (F'S G + N) (R + G'S G)^-1 (G'S F + N') + Q = 0.

    Raises
    ------
    DesignError
        If no stabilising solution exists.
    """
    try:
        return symmetric(np.asarray(solve_discrete_are(F, G, Q, R, s=N)))
    except np.linalg.LinAlgError:
        raise DesignError(_reason(F, G, sampled=True)) from None


def _reason(A: Array, B: Array, *, sampled: bool) -> str:
    stuck = unstable(uncontrollable_modes(A, B), sampled=sampled)
    if stuck.size:
        return f'no input can stabilise the modes at {describe(stuck)}'
    return (
        'the Riccati equation has no stabilising solution: some mode on the stability boundary '
        'has no weight'
    )
