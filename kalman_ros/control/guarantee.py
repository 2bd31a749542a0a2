# SPDX-License-Identifier: Apache-2.0
"""Margins that a sampled regulator is guaranteed to have, without analysing its loop."""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, inf, sqrt

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.core import Array, ArrayLike, semidefinite

from .lqr import Cost, LqrDesign

#: A cost this far below the floor, relative to the weights, is rounding.
_ROUNDING = 1e-10


@dataclass(frozen=True)
class Guarantee:
    """The guaranteed margins of one input, with all states known and without delay.

    Parameters
    ----------
    distance
        a of |1 + L| >= a at all frequencies; at most 1.
    """

    distance: float

    @property
    def lower_gain(self) -> float:
        """1 / (1 + a)."""
        return 1.0 / (1.0 + self.distance)

    @property
    def upper_gain(self) -> float:
        """1 / (1 - a)."""
        return 1.0 / (1.0 - self.distance) if self.distance < 1.0 else inf

    @property
    def phase(self) -> float:
        """2 asin(a / 2), in radians."""
        return 2.0 * asin(0.5 * self.distance)


def sampled_guarantees(
    design: LqrDesign, G: Array, weights: Cost, floor: ArrayLike
) -> tuple[Guarantee, ...]:
    """Return what each input of a `dlqr` design guarantees while the others are closed.

    With M = R + G'S G the loop has (1 + L~) M (1 + L) >= R_0, if no sample costs less than
    u'R_0 u (Shaked, IEEE Trans. Automatic Control 31(2), 1986, where R_0 = R). The sensitivity
    of input i alone is the i-th diagonal element of (1 + L)^-1, so that

        |1 + L_i| >= a_i,  1 / a_i^2 = M_ii (R_0^-1)_ii

    which for one input is a = sqrt(R_0 / (R + G'S G)).

    Parameters
    ----------
    design
        Of ``dlqr`` with these weights.
    G
        Of x' = F x + G u (n, m).
    weights
        The cost of a sample.
    floor
        R_0, its diagonal (m,) or all of it (m, m): R without a cross weight; R dt for the
        `sampled_cost` of R, which the state only increases.

    Raises
    ------
    ValueError
        If some sample costs less than the ``floor``.
    """
    n, m = G.shape
    R_0 = semidefinite('floor', floor, m, definite=True)
    W = weights.weight
    least = float(np.linalg.eigvalsh(W - block_diag(np.zeros((n, n)), R_0)).min())
    if least < -_ROUNDING * np.linalg.norm(W, 2):
        raise ValueError(
            f'floor: expected no sample to cost less, got one that does by {-least:.3g}'
        )
    M = weights.input + G.T @ design.cost_to_go @ G
    squares = M.diagonal() * np.linalg.inv(R_0).diagonal()
    return tuple(Guarantee(sqrt(1.0 / square)) for square in squares.tolist())
