# SPDX-License-Identifier: Apache-2.0
"""From continuous time to sampled time, exactly, by the matrix exponential."""

from __future__ import annotations

import numpy as np

from .arrays import Array, symmetric

# Coefficients of the [13/13] Pade approximant of exp and the 1-norm up to which it is exact to
# double precision: N. Higham, "The scaling and squaring method for the matrix exponential
# revisited", SIAM J. Matrix Anal. Appl. 26(4), 2005, table 2.3 and equation 2.2.
_PADE = (
    64764752532480000.0, 32382376266240000.0, 7771770303897600.0, 1187353796428800.0,
    129060195264000.0, 10559470521600.0, 670442572800.0, 33522128640.0, 1323241920.0,
    40840800.0, 960960.0, 16380.0, 182.0, 1.0,
)  # fmt: skip
_THETA = 5.371920351148152


def exponential(A: Array) -> Array:
    """Return the matrix exponential of ``A`` (n, n), by scaling and squaring."""
    norm = float(np.abs(A).sum(axis=0).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(norm / _THETA)))) if norm > _THETA else 0
    A = A / 2.0**squarings
    b = _PADE
    eye = np.eye(len(A))
    A2 = A @ A
    A4 = A2 @ A2
    A6 = A4 @ A2
    U = A @ (
        A6 @ (b[13] * A6 + b[11] * A4 + b[9] * A2)
        + (b[7] * A6 + b[5] * A4 + b[3] * A2 + b[1] * eye)
    )
    V = A6 @ (b[12] * A6 + b[10] * A4 + b[8] * A2) + (
        b[6] * A6 + b[4] * A4 + b[2] * A2 + b[0] * eye
    )
    result = np.linalg.solve(V - U, V + U)
    for _ in range(squarings):
        result = result @ result
    return np.asarray(result)


def zero_order_hold(A: Array, B: Array, dt: float) -> tuple[Array, Array]:
    """Return F (n, n) and G (n, m) of x(t + dt) = F x(t) + G u, with u held over the step."""
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n] = A * dt
    block[:n, n:] = B * dt
    exp = exponential(block)
    return exp[:n, :n], exp[:n, n:]


def van_loan(A: Array, W: Array, dt: float) -> Array:
    """Return the integral of exp(A s) W exp(A^T s) over s in [0, dt].

    With W (n, n) the spectral density of white noise that drives dx/dt = A x, this is the
    covariance that the noise adds over one step: C. Van Loan, "Computing integrals involving
    the matrix exponential", IEEE Trans. Automatic Control 23(3), 1978.
    """
    n = len(A)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n] = -A * dt
    block[:n, n:] = W * dt
    block[n:, n:] = A.T * dt
    exp = exponential(block)
    return symmetric(exp[n:, n:].T @ exp[:n, n:])
