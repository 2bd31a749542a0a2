# SPDX-License-Identifier: Apache-2.0
"""Dynamics from recorded data: the matrix of a linear recursion, its poles and their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, solve
from kalman_ros.linear.structure import ComplexArray, eigenvalues


@dataclass(frozen=True)
class Fit:
    """A least-squares fit of after = M before + noise.

    Parameters
    ----------
    matrix
        M (n, r).
    gram
        The sum of before before' (r, r), which weights the errors of M.
    """

    matrix: Array
    gram: Array

    @property
    def poles(self) -> ComplexArray:
        """Eigenvalues of the leading square block of M (n,)."""
        return eigenvalues(self.matrix[:, : len(self.matrix)])

    def distance(self, exact: Array, noise: Array) -> float:
        """Return how far M is from an ``exact`` one (n, r): chi-square with n r degrees.

        With D the difference this is tr(N^-1 D G D'), N the ``noise`` covariance (n, n) and G
        the gram matrix (Lutkepohl, New Introduction to Multiple Time Series Analysis, 2005,
        section 3.2.2). Poles have no such simple distribution: two that are close
        scatter along the root of the error.
        """
        D = self.matrix - exact
        return float(np.trace(solve(noise, D @ self.gram @ D.T)))

    def pole_deviations(self, noise: Array) -> Array:
        """Return the standard deviations (n,) of the sampled `poles`, to first order.

        With w and v the left and right eigenvectors of a pole, w v = 1, a small error D of M
        moves it by w D v (Golub and Van Loan, Matrix Computations, 2013, section 7.2.2), and D
        has the covariance N of the ``noise`` (n, n) between rows and the inverse gram matrix
        between columns. Poles that are close together scatter more.
        """
        n = len(self.matrix)
        _, V = np.linalg.eig(self.matrix[:, :n])
        W = np.linalg.inv(V)
        along_rows = np.einsum('pi,ij,pj->p', W, noise, W.conj()).real
        columns = np.linalg.inv(self.gram)[:n, :n]
        along_columns = np.einsum('ip,ij,jp->p', V.conj(), columns, V).real
        return np.asarray(np.sqrt(along_rows * along_columns))


def fit(before: Array, after: Array) -> Fit:
    """Fit after (N, n) = M before (N, r) + noise; ``before`` starts with the same vector."""
    gram = before.T @ before
    return Fit(solve(gram, before.T @ after).T, gram)
