# SPDX-License-Identifier: Apache-2.0
"""The algebraic Riccati equations, with a reason where they have no stabilising solution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, DesignError, symmetric

from .structure import ComplexArray, describe, uncontrollable_modes, unstable

#: A sampled pole this close to 1 is on it but for rounding.
_ENDLESS = 1e-9


class Terms(NamedTuple):
    """What a missing solution is for: modes out of reach, or modes that carry no weight."""

    out_of_reach: str
    weightless: str


CONTROL = Terms(
    'no input can stabilise the modes at',
    'the least-cost gain does not stabilise the system: some mode that does not decay has no '
    'weight in state_cost',
)
ESTIMATION = Terms(
    'no reading tells of the modes at',
    'the error does not decay: some mode that stays has no process noise, so that the filter '
    'ends up ignoring its readings',
)


def continuous(A: Array, B: Array, Q: Array, R: Array, N: Array, terms: Terms) -> Array:
    """Return S of A'S + S A - (S B + N) R^-1 (B'S + N') + Q = 0.

    Raises
    ------
    DesignError
        If no stabilising solution exists.
    """
    from scipy.linalg import solve_continuous_are  # slow to import, so only for a design

    try:
        size = _size(R)
        return size * symmetric(solve_continuous_are(A, B, Q / size, R / size, s=N / size))
    except np.linalg.LinAlgError:
        raise DesignError(_reason(A, B, terms, sampled=False)) from None


def discrete(F: Array, G: Array, Q: Array, R: Array, N: Array, terms: Terms) -> Array:
    """Return S of F'S F - S - (F'S G + N) (R + G'S G)^-1 (G'S F + N') + Q = 0.

    Raises
    ------
    DesignError
        If no stabilising solution exists.
    """
    from scipy.linalg import solve_discrete_are

    try:
        size = _size(R)
        return size * symmetric(solve_discrete_are(F, G, Q / size, R / size, s=N / size))
    except np.linalg.LinAlgError:
        raise DesignError(_reason(F, G, terms, sampled=True)) from None


def _size(R: Array) -> float:
    """Return the size of a weight; S is linear in all weights, but the solvers need R near 1."""
    return float(np.abs(R).max())


def require_stable(poles: ComplexArray, terms: Terms, *, sampled: bool) -> None:
    """Raise DesignError unless every pole decays."""
    slowest = np.max(np.abs(poles)) - 1.0 + _ENDLESS if sampled else np.max(poles.real)
    if not slowest < 0.0:
        raise DesignError(terms.weightless)


def _reason(A: Array, B: Array, terms: Terms, *, sampled: bool) -> str:
    stuck = unstable(uncontrollable_modes(A, B), sampled=sampled)
    return f'{terms.out_of_reach} {describe(stuck)}' if stuck.size else terms.weightless
