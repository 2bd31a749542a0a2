# SPDX-License-Identifier: Apache-2.0
"""The steady-state Kalman filter, in continuous and in sampled time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, solve

from . import riccati
from .structure import ComplexArray, eigenvalues


@dataclass(frozen=True)
class LqeDesign:
    """An observer with the least error covariance.

    Parameters
    ----------
    gain
        L (n, k). In sampled time the gain of the current estimate: x_hat += L (y - C x_hat).
    covariance
        The error covariance (n, n); in sampled time after the reading.
    prior
        In sampled time the error covariance before the reading; else the same as ``covariance``.
    poles
        Eigenvalues of the error dynamics (n,): of A - L C, or of (I - L C) F when sampled.
    """

    gain: Array
    covariance: Array
    prior: Array
    poles: ComplexArray


def lqe(A: Array, C: Array, W: Array, V: Array) -> LqeDesign:
    """Return the Kalman-Bucy gain L = P C'V^-1 for noise densities W (n, n) and V (k, k).

    Raises
    ------
    DesignError
        If the readings cannot keep the error of some mode bounded.
    """
    P = riccati.continuous(A.T, C.T, W, V, np.zeros(C.T.shape))
    L = solve(V, C @ P).T
    return LqeDesign(L, P, P, eigenvalues(A - L @ C))


def dlqe(F: Array, C: Array, Q: Array, R: Array) -> LqeDesign:
    """Return the steady-state gain of x' = F x + w, y = C x + v; w ~ N(0, Q), v ~ N(0, R).

    Raises
    ------
    DesignError
        If the readings cannot keep the error of some mode bounded.
    """
    P = riccati.discrete(F.T, C.T, Q, R, np.zeros(C.T.shape))
    L = solve(C @ P @ C.T + R, C @ P).T
    I_LC = np.eye(len(F)) - L @ C
    return LqeDesign(L, I_LC @ P, P, eigenvalues(I_LC @ F))
