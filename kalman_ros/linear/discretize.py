# SPDX-License-Identifier: Apache-2.0
"""From continuous time to sampled time, exactly.

One step of dx/dt = A x + B u + w, with u held and w white of spectral density W, is

    F = exp(A dt),  G = integral of exp(A s) B,  Q = integral of exp(A s) W exp(A' s)

over s in [0, dt] (C. Van Loan, "Computing integrals involving the matrix exponential", IEEE
Trans. Automatic Control 23(3), 1978). Each is a power series in dt, so that a step of any length
costs one product with a table of coefficients. Steps too long for the series are halved and
doubled again by F <- F F, G <- G + F G, Q <- Q + F Q F', in which no large terms cancel.
"""

from __future__ import annotations

from math import ceil, inf, log2

import numpy as np

from .arrays import Array, symmetric

#: The longest step for which the series is used, relative to 1 / ||L||, and its terms: what is
#: left out is less than 1 / 19!, below double precision.
_LONGEST = 1.0
_TERMS = 18


class Discretization:
    """F (n, n), G (n, m) and Q (n, n) as functions of dt, for A (n, n), B (n, m) and W (n, n)."""

    def __init__(self, A: Array, B: Array, W: Array) -> None:
        n, m = B.shape
        # the derivatives of Q at 0 are those of exp(A s) W exp(A' s): X -> A X + X A', whose norm
        # is at most twice that of A
        self._norm = 2.0 * float(np.abs(A).sum(axis=0).max(initial=0.0))
        self._powers = np.arange(_TERMS + 1)
        self._shapes = (n, m)
        F: Array = np.eye(n)
        G: Array = np.zeros((n, m))
        Q: Array = np.zeros((n, n))
        table = [(F, G, Q)]
        for k in range(1, _TERMS + 1):
            AQ = A.dot(Q) if k > 1 else 0.5 * W
            F, G, Q = A.dot(F) / k, (A.dot(G) if k > 1 else B) / k, (AQ + AQ.T) / k
            table.append((F, G, Q))
        # column-major, for BLAS
        columns = [[each.ravel('F') for each in row] for row in table]
        self._table = np.array([np.concatenate(row) for row in columns])

    def __call__(self, dt: float) -> tuple[Array, Array, Array]:
        """Return F, G and Q of a step of ``dt`` seconds.

        Raises
        ------
        numpy.linalg.LinAlgError
            If A is so large that no halving makes the step short enough, or what grows does so
            beyond all numbers within the step.
        """
        reach = self._norm * abs(dt) / _LONGEST
        if reach == inf:
            raise np.linalg.LinAlgError('the Jacobian of the model is infinite')
        halvings = ceil(log2(reach)) if reach > 1.0 else 0
        n, m = self._shapes
        flat = ((dt / 2.0**halvings) ** self._powers).dot(self._table)
        F = flat[: n * n].reshape(n, n, order='F')
        G = flat[n * n : n * (n + m)].reshape(n, m, order='F')
        Q = flat[n * (n + m) :].reshape(n, n, order='F')
        if halvings:
            F, G, Q = _doubled(F, G, Q, halvings)
            if not all(np.isfinite(each).all() for each in (F, G, Q)):
                raise np.linalg.LinAlgError(
                    f'the model grows beyond all numbers within a step of {dt:g} s'
                )
        return F, G, symmetric(Q).T


@np.errstate(over='ignore', invalid='ignore')
def _doubled(F: Array, G: Array, Q: Array, times: int) -> tuple[Array, Array, Array]:
    """Return F, G and Q of a step that is 2 ** ``times`` as long."""
    for _ in range(times):
        G, Q = G + F.dot(G), Q + F.dot(Q).dot(F.T)
        F = F.dot(F)
    return F, G, Q


def zero_order_hold(A: Array, B: Array, dt: float) -> tuple[Array, Array]:
    """Return F (n, n) and G (n, m) of x(t + dt) = F x(t) + G u, with u held over the step."""
    F, G, _ = Discretization(A, B, np.zeros(A.shape))(dt)
    return F, G


def van_loan(A: Array, W: Array, dt: float) -> Array:
    """Return the integral of exp(A s) W exp(A' s) over s in [0, dt].

    With W (n, n) the spectral density of white noise that drives dx/dt = A x, this is the
    covariance that the noise adds over one step.
    """
    return Discretization(A, np.zeros((len(A), 0)), W)(dt)[2]
