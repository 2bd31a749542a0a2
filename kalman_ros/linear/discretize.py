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

from bisect import bisect_right
from functools import lru_cache
from math import ceil, factorial, inf, log2, sqrt

import numpy as np

from .batched import MANY, product
from .matrices import Array, identity, symmetric

#: The longest step for which the series is used, relative to 1 / ||L||, and its terms: the
#: truncation error is below 1 / 19!, less than double precision.
_LONGEST = 1.0
_TERMS = 18
#: Number of terms with the constant one.
TERMS = _TERMS + 1
#: With more halvings, too many digits of F - I are lost beside the diagonal of F: one bit each.
_MANY_HALVINGS = 8
#: Up to a diagonal of F - I of this size it is doubled in place of F.
_NEAR_IDENTITY = 0.125
#: The least reach of a series: shorter steps have no fewer terms.
_SHORTEST = 1e-3


class Discretization:
    """F (n, n), G (n, m) and Q (n, n) as functions of dt, for A (n, n), B (n, m) and W (n, n).

    With the ``longest`` dt, in seconds, the series has no more terms than that needs; a longer
    step is halved.
    """

    def __init__(self, A: Array, B: Array, W: Array, longest: float = inf) -> None:
        n, m = B.shape
        # the derivatives of Q at 0 are those of exp(A s) W exp(A' s): X -> A X + X A', whose norm
        # is at most twice that of A
        self._norm = 2.0 * float(np.abs(A).sum(axis=0).max(initial=0.0))
        #: The longest step relative to 1 / ||L||.
        self._reach = _LONGEST
        if longest < inf:
            self._reach = min(_LONGEST, max(self._norm * abs(longest), _SHORTEST))
        count = _terms(self._reach)
        self._powers = np.arange(count + 1.0)
        self._shapes = (n, m)
        # the terms of F', G' and Q' one below the other, so that one product makes all three
        terms = np.zeros((count + 1, 2 * n + m, n))
        terms[0, :n].flat[:: n + 1] = 1.0
        At = A.T
        for k in range(1, count + 1):
            term = np.dot(terms[k - 1], At, out=terms[k])
            if k == 1:
                term[n:-n], term[-n:] = B.T, 0.5 * W
            term[-n:] += term[-n:].T.copy()
            term /= k
        self._table = terms.reshape(count + 1, -1)

    @property
    def series(self) -> tuple[float, Array]:
        """Twice the norm of A, and the terms of F', G' and Q' (TERMS, (2n + m) n).

        Powers of dt times these terms are the matrices of a step up to 1 / that norm.
        """
        return self._norm, self._table

    def __call__(self, dt: float) -> tuple[Array, Array, Array]:
        """Return F, G and Q of a step of ``dt`` seconds.

        Raises
        ------
        numpy.linalg.LinAlgError
            If A is so large that no halving makes the step short enough, or a growing mode
            overflows within the step.
        """
        reach = self._norm * abs(dt) / self._reach
        if reach == inf:
            raise np.linalg.LinAlgError('the Jacobian of the model is infinite')
        halvings = ceil(log2(reach)) if reach > 1.0 else 0
        n, m = self._shapes
        powers = (dt / 2.0**halvings) ** self._powers
        flat = powers.dot(self._table)
        F = flat[: n * n].reshape(n, n, order='F')
        G = flat[n * n : n * (n + m)].reshape(n, m, order='F')
        Q = flat[n * (n + m) :].reshape(n, n, order='F')
        if halvings > _MANY_HALVINGS:
            E = powers[1:].dot(self._table[1:, : n * n]).reshape(n, n, order='F')
            E, G, Q, halvings = _doubled_change(E, G, Q, halvings)
            F = np.eye(n) + E
        if reach > 1.0:
            F, G, Q = _doubled(F, G, Q, halvings)
            if not all(np.isfinite(matrix).all() for matrix in (F, G, Q)):
                raise np.linalg.LinAlgError(
                    f'the model grows beyond all numbers within a step of {dt:g} s'
                )
        return F, G, symmetric(Q).T


def _terms(reach: float) -> int:
    """Return the number of terms with a truncation error as small as that of `_TERMS`.

    With the constant one they are a multiple of four: BLAS adds rows in fours, so the sum rounds
    as that of all terms.
    """
    negligible = _LONGEST ** (_TERMS + 1) / factorial(_TERMS + 1)
    enough = (k for k in range(3, _TERMS, 4) if reach ** (k + 1) / factorial(k + 1) <= negligible)
    return next(enough, _TERMS)


@np.errstate(over='ignore', invalid='ignore')
def _doubled_change(E: Array, G: Array, Q: Array, times: int) -> tuple[Array, Array, Array, int]:
    """Return E = F - I, G and Q of a longer step, and how many doublings of it remain.

    F, near I in a step that is short for every mode, has the digits of E that are left beside 1.
    The diagonal, which no units of the states change, says up to where.
    """
    while times and np.abs(E.diagonal()).max(initial=0.0) < _NEAR_IDENTITY:
        F = np.eye(len(E)) + E
        G, Q, E = G + F.dot(G), Q + F.dot(Q).dot(F.T), 2.0 * E + E.dot(E)
        times -= 1
    return E, G, Q, times


@np.errstate(over='ignore', invalid='ignore')
def _doubled(F: Array, G: Array, Q: Array, times: int) -> tuple[Array, Array, Array]:
    """Return F, G and Q of a step that is 2 ** ``times`` as long."""
    for _ in range(times):
        G, Q = G + F.dot(G), Q + F.dot(Q).dot(F.T)
        F = F.dot(F)
    return F, G, Q


#: The remainder of the series of `flow`, relative to its sum.
_NEGLIGIBLE = 1e-15
#: The norms from which on 4, 6, ... terms are not enough, norm^N / N! being that remainder.
_REACHES = [(_NEGLIGIBLE * factorial(N)) ** (1.0 / N) for N in range(4, _TERMS - 2, 2)]
#: From this bound of the remainder on, the last term of a large stack is looked at: the bound is
#: often pessimistic, and to look costs a quarter of a term.
_WORTH_MEASURING = 1e-6


def flow(A: Array, W: Array, dt: float) -> tuple[Array, Array]:
    """Return F and Q of a step of ``dt`` seconds, for A and W (..., n, n), with any leading axes.

    They are those of `Discretization`, for an A that changes at every step: the series ends where
    its remainder is negligible.

    Raises
    ------
    numpy.linalg.LinAlgError
        If A or the result is not finite.
    """
    F, Q = _flow(A, W, dt, with_F=True)
    assert F is not None
    return F, Q


def noise_integral(A: Array, W: Array, dt: float) -> Array:
    """Return Q (..., n, n) alone, as `flow` does."""
    return _flow(A, W, dt, with_F=False)[1]


def _flow(A: Array, W: Array, dt: float, *, with_F: bool) -> tuple[Array | None, Array]:
    reach = 2.0 * abs(dt) * float(np.abs(A).sum(axis=-2).max(initial=0.0))
    if not reach < inf:
        raise np.linalg.LinAlgError('the Jacobian of the model is not finite')
    halvings = ceil(log2(reach / _LONGEST)) if reach > _LONGEST else 0
    reach, h = reach / 2.0**halvings, dt / 2.0**halvings
    F: Array | None
    if A.ndim > 2 and A.size < MANY:
        F, Q = _short_flow(A * h, W * h, 0.5 * reach)
    else:
        F, Q = _summed_flow(A * h, W * h, reach, with_F=with_F or bool(halvings))
    for _ in range(halvings):
        assert F is not None
        with np.errstate(over='ignore', invalid='ignore'):
            Q = Q + product(product(F, Q), F.swapaxes(-1, -2))
            F = product(F, F)
    # a sum is finite as its matrices are; doubled, it may overflow
    if not np.isfinite(Q).all() or (halvings and F is not None and not np.isfinite(F).all()):
        raise np.linalg.LinAlgError(
            f'the model grows beyond all numbers within a step of {dt:g} s'
        )
    return F, symmetric(Q) if halvings else Q


def _summed_flow(
    A_h: Array, W_h: Array, reach: float, *, with_F: bool
) -> tuple[Array | None, Array]:
    """Return F and Q of a short step, with sums that end where the rest is negligible."""
    F_term, term = A_h, W_h
    Q = term
    F: Array | None = np.eye(A_h.shape[-1]) + A_h if with_F else None
    bound = reach
    for k in range(2, _TERMS + 1):
        if bound < _NEGLIGIBLE:
            break
        measured = A_h.size >= MANY and bound < _WORTH_MEASURING
        if measured and _vanishes(term, Q) and (F is None or _vanishes(F_term, F)):
            break
        half = product(A_h, term)
        half *= 1.0 / k
        term = half + half.swapaxes(-1, -2)
        Q = Q + term
        bound *= reach / k
        if F is not None:
            F_term = product(A_h, F_term)
            F_term *= 1.0 / k
            F = F + F_term
    return F, Q


def _short_flow(A_h: Array, W_h: Array, norm: float) -> tuple[Array, Array]:
    """Return F and Q of a short step for few matrices, in as few calls as possible.

    F is the sum of A^k / k!, and Q the integral of exp(A s) W exp(A' s) by Gauss's quadrature,
    exact up to the order of the last term of F.
    """
    square = A_h @ A_h
    # for even N, ||A^N|| is at most ||A^2||^(N / 2), which is often much less than ||A||^N
    norm = min(norm, sqrt(float(np.abs(square).sum(axis=-2).max(initial=0.0))))
    count = 4 + 2 * bisect_right(_REACHES, norm)
    powers = np.empty((count, *A_h.shape))
    powers[0], powers[1], powers[2] = identity(A_h.shape[-1]), A_h, square
    known = 2
    while known < count - 1:
        more = min(known, count - 1 - known)
        np.matmul(powers[1 : more + 1], powers[known], out=powers[known + 1 : known + more + 1])
        known += more
    sums = _weights(count).dot(powers.reshape(count, -1)).reshape(-1, *A_h.shape)
    F, nodes = sums[0], sums[1:]
    return F, symmetric((nodes @ W_h @ nodes.swapaxes(-1, -2)).sum(axis=0))


@lru_cache
def _weights(count: int) -> Array:
    """Return the coefficients of A^k (1 + N / 2, N) in exp(A), and in sqrt(w) exp(A s).

    The nodes s and the weights w are those of Gauss and Legendre on [0, 1].
    """
    s, w = np.polynomial.legendre.leggauss(count // 2)
    s, w = np.append(1.0, 0.5 * (s + 1.0)), np.append(1.0, 0.5 * w)
    terms = np.vander(s, count, increasing=True) / [float(factorial(k)) for k in range(count)]
    return np.asarray(np.sqrt(w)[:, np.newaxis] * terms)


def _vanishes(term: Array, total: Array) -> bool:
    """Return whether the terms after ``term``, which are less, are negligible in every sum."""
    largest = np.abs(term).max(axis=(-2, -1))
    return bool((largest <= _NEGLIGIBLE * np.einsum('...ii->...', total)).all())


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
