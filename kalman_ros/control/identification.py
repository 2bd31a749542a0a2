# SPDX-License-Identifier: Apache-2.0
"""Poles from recorded data, with how sure one can be of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array


@dataclass(frozen=True)
class FittedPoles:
    """Eigenvalues fitted to data (n,), and the standard deviation of their distance (n,)."""

    poles: Array
    std: Array


def fit_poles(before: Array, after: Array) -> FittedPoles:
    """Fit after = M before + noise by least squares and return the eigenvalues of M's front.

    The deviations follow from those of the fit, cov(M) = noise covariance x (before before')^-1
    (Lutkepohl, New Introduction to Multiple Time Series Analysis, section 3.2), carried to the
    eigenvalues to first order.

    Parameters
    ----------
    before
        Regressors (N, r), the first n of which are the vector whose poles are sought.
    after
        That vector one step later (N, n).
    """
    n = after.shape[1]
    gram = before.T @ before
    M = np.linalg.solve(gram, before.T @ after).T
    residual = after - before @ M.T
    noise = residual.T @ residual / max(1, len(after) - before.shape[1])
    poles, right = np.linalg.eig(M[:, :n])
    left = np.linalg.inv(right)  # rows, scaled so that left @ right = 1
    spread = np.linalg.inv(gram)[:n, :n]
    std = np.sqrt(
        np.einsum('ij,jk,ik->i', left, noise, left.conj()).real
        * np.einsum('ji,jk,ki->i', right.conj(), spread, right).real
    )
    return FittedPoles(poles, std)


def continuous_poles(poles: Array, dt: float) -> Array:
    """Return s = log(z) / dt of sampled poles z; a pole at zero becomes minus infinity."""
    with np.errstate(divide='ignore'):
        return np.log(np.asarray(poles, dtype=complex)) / dt
