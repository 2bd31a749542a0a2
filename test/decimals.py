# SPDX-License-Identifier: Apache-2.0
"""The discrete Riccati equation in a hundred digits, by doubling (B. Anderson, 1978)."""

from decimal import Decimal, localcontext

import numpy as np


def steady_filter(F, C, Q, R):
    """Return the covariance before the reading, the gain, and the covariance after it."""
    with localcontext() as context:
        context.prec = 100
        F, C, Q, R = map(_decimal, (F, C, Q, R))
        A, G, P, eye = F.T, C.T @ _inverse(R) @ C, Q, _decimal(np.eye(len(F)))
        for _ in range(60):
            W = _inverse(eye + G @ P)
            A, G, P = A @ W @ A, G + A @ W @ G @ A.T, P + A.T @ P @ W @ A
        L = P @ C.T @ _inverse(C @ P @ C.T + R)
        return tuple(np.array(each, dtype=float) for each in (P, L, P - L @ C @ P))


def _decimal(M):
    return np.array([[Decimal(float(v)) for v in row] for row in M], dtype=object)


def _inverse(M):
    """Return the inverse by Gauss and Jordan, with pivots."""
    n = len(M)
    rows = np.hstack((M, _decimal(np.eye(n))))
    for i in range(n):
        pivot = max(range(i, n), key=lambda k: abs(rows[k, i]))
        rows[[i, pivot]] = rows[[pivot, i]]
        rows[i] = rows[i] / rows[i, i]
        for j in range(n):
            if j != i:
                rows[j] = rows[j] - rows[j, i] * rows[i]
    return rows[:, n:]
