# SPDX-License-Identifier: Apache-2.0
"""Dynamics from recorded data: the matrix of a linear recursion, its poles, and how far off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, solve

from .structure import ComplexArray, eigenvalues


@dataclass(frozen=True)
class Fit:
    """A least-squares fit of after = M before + noise.

    Parameters
    ----------
    matrix
        M (n, r).
    gram
        The sum of before before' (r, r), which weighs the errors of M.
    """

    matrix: Array
    gram: Array

    @property
    def poles(self) -> ComplexArray:
        """Eigenvalues of the front of M, the part that takes the vector into itself (n,)."""
        return eigenvalues(self.matrix[:, : len(self.matrix)])

    def distance(self, exact: Array, noise: Array) -> float:
        """Return how far M is from an ``exact`` one (n, r): chi-square with n r degrees.

        With D the difference this is tr(N^-1 D G D'), N the ``noise`` covariance (n, n) and G
        the gram matrix (Lutkepohl, New Introduction to Multiple Time Series Analysis, 2005,
        section 3.2.2). Poles themselves have no such simple distribution: two that lie close
        scatter along the root of the error.
        """
        D = self.matrix - exact
        return float(np.trace(solve(noise, D @ self.gram @ D.T)))


def fit(before: Array, after: Array) -> Fit:
    """Fit after (N, n) = M before (N, r) + noise; the front of ``before`` is the same vector."""
    gram = before.T @ before
    return Fit(solve(gram, before.T @ after).T, gram)


def continuous_poles(poles: ComplexArray, dt: float) -> ComplexArray:
    """Return s = log(z) / dt of sampled poles z; a pole at zero becomes minus infinity."""
    with np.errstate(divide='ignore'):
        return np.asarray(np.log(poles.astype(complex)) / dt, dtype=np.complex128)
