# SPDX-License-Identifier: Apache-2.0
"""The covariance that white noise leaves in a stable system, by Lyapunov's equation."""

from __future__ import annotations

import numpy as np

from .matrices import Array, symmetric
from .structure import balancing


def stationary_covariance(A: Array, noise: Array, *, sampled: bool) -> Array:
    """Return X = A X A' + noise, or of A X + X A' + noise = 0 in continuous time (n, n).

    States are balanced first, so that their units do not matter.

    Parameters
    ----------
    A
        A stable matrix (n, n).
    noise
        A symmetric matrix (n, n): a covariance, or a spectral density in continuous time.
    sampled
        Whether time is discrete.
    """
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

    unit = balancing(A)
    scale = unit * unit[:, np.newaxis]
    balanced, noise = A * unit / unit[:, np.newaxis], noise / scale
    if sampled:
        X = solve_discrete_lyapunov(balanced, noise)
    else:
        X = solve_continuous_lyapunov(balanced, -noise)
    covariance: Array = symmetric(np.asarray(X)) * scale
    return covariance
