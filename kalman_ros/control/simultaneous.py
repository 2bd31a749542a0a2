# SPDX-License-Identifier: Apache-2.0
"""Margins of several loops at once: each input changes its gain and phase independently.

Loops that are each robust alone may not be robust together: a satellite with infinite gain
margin and 90 degrees of phase in each of its two loops becomes unstable when both change by a
tenth in opposite directions (Zhou, Doyle and Glover, Robust and Optimal Control, 1996, section
9.6; Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 3.7.1).
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np

from kalman_ros.core import Array, DesignError
from kalman_ros.linear.structure import ComplexArray, describe, unstable

from .crossings import balanced, continuous, frequency, singular_crossings
from .margins import DiskMargin
from .state_space import StateSpace

#: The relative accuracy of the peak over all frequencies.
_PEAK = 1e-6
#: The most intervals of frequency to search; never reached.
_MOST_INTERVALS = 2000
#: Orders of the norms used to find scalings, smooth ones first.
_ORDERS = (4, 32, 256, 2048)


def simultaneous_disk(loop: StateSpace) -> DiskMargin:
    """Return the largest change that all inputs of a loop L (m, m) tolerate at once.

    The loop stays stable while each input is multiplied by its own factor (1 + d/2) / (1 - d/2),
    |d| < alpha, so alpha = 2 / max mu(S - T), with mu the structured singular value for
    diagonal complex changes. For one input it is the disk margin of `margins`. It is the bound
    of `structured_bound`, hence exact for up to three inputs, and on the safe side for more.

    Raises
    ------
    DesignError
        If the closed loop is not stable.
    """
    T = loop.closed()
    if not T.stable:
        poles = unstable(T.poles, sampled=loop.sampled)
        raise DesignError(f'loop: unstable when closed, with poles at {describe(poles)}')
    eye = np.eye(len(T.D))
    peak, w = structured_peak(StateSpace(T.A, T.B, -2.0 * T.C, eye - 2.0 * T.D, T.dt))
    return DiskMargin.of_peak(peak, w)


def structured_bound(M: ComplexArray) -> tuple[float, Array]:
    """Return an upper bound of mu(M) for diagonal complex changes, and the scaling d (m,) of it.

    1 / mu is the size of the smallest diagonal matrix of complex numbers that makes I - M Delta
    singular. The bound is the least norm of D M D^-1 over positive diagonal D, which is mu
    itself for m <= 3 (A. Packard and J. Doyle, The Complex Structured Singular Value, Automatica
    29(1), 1993). The logarithm of the norm is convex in that of d.

    Parameters
    ----------
    M
        Square (m, m), complex.
    """
    m = len(M)
    x = _osborne(np.abs(M))
    if m > 2 and np.any(M):  # of two the least Frobenius norm has the least norm as well
        x = _refined(M, x)
    d = np.exp(x)
    return float(np.linalg.norm(M * np.outer(d, 1.0 / d), 2)), d


def _osborne(size: Array) -> Array:
    """Return log d (m,) for the least Frobenius norm (E. Osborne, J. ACM 7(4), 1960)."""
    squares = size**2
    np.fill_diagonal(squares, 0.0)
    # uncoupled inputs need no scaling, but then the least norm is only approached
    squares = squares + 1e-24 * float(squares.max(initial=0.0))
    d = np.ones(len(size))
    for _ in range(200):
        before = d.copy()
        for i in range(len(d)):
            out, back = squares[i] @ d**-2, squares[:, i] @ d**2
            if out > 0.0 and back > 0.0:
                d[i] = (back / out) ** 0.25
        if np.all(np.abs(d - before) <= 1e-12 * d):
            break
    return np.asarray(np.log(d / d[0]))


def _refined(M: ComplexArray, x: Array) -> Array:
    """Return log d (m,) for the least norm, by Schatten norms, which are smooth, of rising order.

    The largest singular value itself has kinks, most of all where it is least.
    """
    from scipy.optimize import minimize  # slow import

    def norm(free: Array, order: int) -> tuple[float, Array]:
        logs = np.concatenate(([0.0], free))
        U, sizes, Vh = np.linalg.svd(M * np.exp(logs[:, np.newaxis] - logs))
        shares = (sizes / sizes[0]) ** order
        total = shares.sum()
        # d log |DMD^-1| / d log d_i of one singular value is |u_i|^2 - |v_i|^2
        slopes = (np.abs(U) ** 2 - np.abs(Vh.conj().T) ** 2) @ (shares / total)
        return float(np.log(sizes[0]) + np.log(total) / order), np.asarray(slopes[1:])

    best = x[1:]
    for order in _ORDERS:
        optimum = minimize(norm, best, args=(order,), jac=True, method='BFGS')
        if norm(optimum.x, 10**6)[0] <= norm(best, 10**6)[0]:
            best = optimum.x
    return np.concatenate(([0.0], best))


def structured_peak(system: StateSpace) -> tuple[float, float]:
    """Return the largest `structured_bound` of a stable system (m, m), and where, in rad/s.

    No grid is searched. With the scaling at one frequency the norm is below the level of the
    peak in a whole interval around it, whose ends are eigenvalues; the gaps between intervals are
    searched in turn (C. Lawrence, A. Tits and P. Van Dooren, A fast algorithm for the
    computation of an upper bound on the mu-norm, Automatica 36(3), 2000).
    """
    M = continuous(system)
    scales = np.abs(np.concatenate((M.poles, M.poles.imag)))
    starts = [0.0, inf, *np.unique(scales[scales > 0.0]).tolist()]
    level, at = max((structured_bound(_at(M, w))[0], w) for w in starts)
    left = [(0.0, inf)]
    for count in range(_MOST_INTERVALS):
        if count < len(starts):
            w = starts[count]
        elif left:
            w = _inside(*left[-1])
        else:
            break
        bound, d = structured_bound(_at(M, w))
        if bound > level:
            bound, w, d = _climbed(M, w)
            level, at = bound, w
        ends = _covered(_scaled(M, d), w, level * (1.0 + _PEAK))
        left = [piece for gap in left for piece in _without(gap, ends)]
    return level, frequency(at, system.dt)


def _at(M: StateSpace, w: float) -> ComplexArray:
    return M.D.astype(complex) if w == inf else M.at(1j * w)


def _scaled(M: StateSpace, d: Array) -> StateSpace:
    """Return D M D^-1."""
    D = M.D * np.outer(d, 1.0 / d)
    return balanced(StateSpace(M.A, M.B / d, d[:, np.newaxis] * M.C, D))


def _inside(low: float, high: float) -> float:
    if low == 0.0:
        return 0.1 * high if high < inf else 1.0
    return sqrt(low * high) if high < inf else 10.0 * low


def _climbed(M: StateSpace, w: float) -> tuple[float, float, Array]:
    """Return the bound at a peak near ``w``, the frequency there, and its scaling."""
    from scipy.optimize import minimize_scalar

    if 0.0 < w < inf:
        optimum = minimize_scalar(
            lambda x: -structured_bound(_at(M, w * float(np.exp(x))))[0],
            bounds=(-0.5, 0.5), method='bounded', options={'xatol': 1e-7},
        )  # fmt: skip
        if -optimum.fun > structured_bound(_at(M, w))[0]:
            w *= float(np.exp(optimum.x))
    bound, d = structured_bound(_at(M, w))
    return bound, w, d


def _covered(M: StateSpace, w: float, level: float) -> tuple[float, float]:
    """Return the interval about ``w`` in which the norm of M is below ``level``."""
    ends = [0.0, *singular_crossings(M, level).tolist(), inf]
    if any(abs(end - w) <= 1e-12 * w for end in ends if 0.0 < w < inf):
        return w, w
    last = int(np.searchsorted(ends, w, side='right')) - 1
    low = high = min(last, len(ends) - 2)

    def below(k: int) -> bool:
        middle = _inside(ends[k], ends[k + 1])
        return bool(np.linalg.norm(_at(M, middle), 2) < level)

    # skip a crossing due to rounding
    while low > 0 and below(low - 1):
        low -= 1
    while high + 2 < len(ends) and below(high + 1):
        high += 1
    return ends[low], ends[high + 1]


def _without(gap: tuple[float, float], ends: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the rest of a gap; parts shorter than the accuracy of the peak are covered, too."""
    low, high = gap
    pieces = [(low, min(high, ends[0])), (max(low, ends[1]), high)]
    if ends[0] == ends[1]:
        pieces = [
            (low, min(high, ends[0] * (1.0 - 1e-6))),
            (max(low, ends[1] * (1.0 + 1e-6)), high),
        ]
    if high <= ends[0] or low >= ends[1]:
        return [gap]
    return [piece for piece in pieces if piece[1] > piece[0] * (1.0 + 1e-7) and piece[1] > 0.0]
