# SPDX-License-Identifier: Apache-2.0
"""One storage function for all loops of a box of parameters.

A sampled loop x' = A x + B w, z = C x + D w depends on constant parameters p. Let
M = [[A, B], [C, D]]. If it is stable at one p, and if some P(p) has

    M(p)' diag(P(p), 1) M(p) <= diag(P(p), g^2)

for all p in a box, then x'P x is a storage function of each of these loops: they are stable, and
|z| <= g |w| (J. Willems, Arch. Rational Mech. Anal. 45, 1972; S. Boyd et al., Linear Matrix
Inequalities in System and Control Theory, 1994, chapters 5 to 7). Without w the sum of |z|^2
from x on is at most x'P x. Here M is a polynomial of second degree in each parameter, and P is
linear: that of the centre with its derivatives. Both sides are then polynomials, whose Bernstein
coefficients are checked. What M differs from its polynomial by is measured, and twice as much is
allowed for.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from scipy.linalg import solve_discrete_are

from kalman_ros.core import Array
from kalman_ros.linear.bernstein import DEGREE, at_nodes, centre, coefficients, slopes
from kalman_ros.linear.lyapunov import stationary_covariance
from kalman_ros.linear.matrices import symmetric

#: Iterations for a storage function, and how much larger than the differences it is made.
_ITERATIONS, _MARGIN = 40, 1.05
#: A storage function that grows by more than this does not end.
_MOST_GROWTH = 1e6
#: How many times the measured difference of M from its polynomial is allowed for.
SAFETY = 2.0
#: Share of the cost that is added so that a storage function proves stability, too.
_FLOOR = 1e-3
#: Matrices whose positive parts make up a cover.
_COVERED = 4
#: Poles beyond count as unstable.
_STABLE = 1.0 - 1e-9


@np.errstate(over='ignore', invalid='ignore')  # what is not finite is no storage function
def storage_function(
    grid: Array,
    rest: Array,
    level: float,
    floor: Array,
    enough: Callable[[Array], bool] = lambda P: True,
) -> Array | None:
    """Return a storage function P of all loops of a box at its nodes (N, n, n).

    Its centre solves the equation of the centre of M with an addition E, which is raised until
    it covers what the inequality lacks elsewhere. None if that does not end.

    Parameters
    ----------
    grid
        [[A, B], [C, D]] (3, ..., 3, n + p, n + m); without B and D the level is infinite.
    rest
        What others in the box differ by from the polynomial of these (K, n + p, n + m).
    level
        g.
    floor
        A symmetric matrix (n, n) >= 0 that is added to C'C.
    enough
        Whether a P, which only grows, is still small enough.
    """
    try:
        return _iterated(grid, rest, level, floor, enough)
    except np.linalg.LinAlgError:
        return None


def _iterated(
    grid: Array, rest: Array, level: float, floor: Array, enough: Callable[[Array], bool]
) -> Array | None:
    """Return a storage function, or None, as `storage_function` does."""
    n, d = len(floor), grid.ndim - 2
    middle, sides, M = centre(grid, d), slopes(grid, d), at_nodes(grid, d)
    at = np.array(list(product(np.linspace(-1.0, 1.0, DEGREE + 1), repeat=d)))
    E, first = np.zeros((n, n)), None
    for _ in range(_ITERATIONS):
        P = _solution(middle, level, floor + E)
        change = None if P is None else _derivatives(middle, sides, P, level)
        if P is None or change is None:
            return None
        first = P if first is None else first
        if not np.trace(_scaled(P, first)) <= _MOST_GROWTH * n:
            return None
        everywhere = P + np.tensordot(at, change, 1)
        if not enough(everywhere):
            return None
        margin = _margin(rest, P, level)
        excess = _excess(coefficients(_form(M, everywhere, floor, level, margin), d), n)
        if excess is None:
            return None
        lacking = np.linalg.eigvalsh(_scaled(excess, P))[:, -1] > 0.0
        if not lacking.any():
            return everywhere
        E = _cover(_MARGIN * (excess[lacking] + E), E, P)
    return None


def decrease(M: Array, noise: Array) -> Array | None:
    """Return what makes x'P x decrease in all states: about a thousandth of the cost."""
    n = len(noise)
    A, C = M[:n], M[n:]
    covariance = cost_to_go(A.T, noise)
    if covariance is None:
        return None
    spread = covariance.diagonal()
    covariance = covariance + np.diag(1e-6 * spread + 1e-12 * max(spread.max(), 1e-300))
    cost = float(np.einsum('ij,jk,ik', C, covariance, C)) or 1.0
    inverse: Array = np.asarray(np.linalg.inv(covariance), dtype=float)
    return symmetric(_FLOOR * cost / n * inverse)


def cost_to_go(A: Array, Q: Array) -> Array | None:
    """Return X = A'X A + Q; None if A is unstable, or nearly so."""
    if not np.abs(np.linalg.eigvals(A)).max(initial=0.0) < _STABLE:
        return None
    return stationary_covariance(A.T, Q, sampled=True)


def _solution(M: Array, level: float, added: Array) -> Array | None:
    """Return P of the equation P = A'P A + C'C + added + (..)(g^2 - ..)^-1(..)', if it is >= 0."""
    n = len(added)
    A, B, C, D = M[:n, :n], M[:n, n:], M[n:, :n], M[n:, n:]
    Q = C.T @ C + added
    if not B.size:
        P = cost_to_go(A, Q)
    else:
        try:
            R = D.T @ D - level**2 * np.eye(B.shape[1])
            P = symmetric(solve_discrete_are(A, B, Q, R, s=C.T @ D))
        except (np.linalg.LinAlgError, ValueError):
            return None
    if P is None:
        return None
    least, most = np.linalg.eigvalsh(_scaled(P, P))[[0, -1]]
    return P if np.isfinite(most) and least > -1e-9 else None


def _derivatives(M: Array, slopes: Array, P: Array, level: float) -> Array | None:
    """Return the derivatives (d, n, n) of the P of the centre by those of M (d, ...)."""
    n = len(P)
    A, B, D = M[:n, :n], M[:n, n:], M[n:, n:]
    weighted = np.concatenate((P @ M[:n], M[n:]))
    worst = np.eye(n)
    if B.size:
        inner = level**2 * np.eye(B.shape[1]) - D.T @ D - B.T @ P @ B
        gain = np.linalg.solve(inner, M[:, n:].T @ weighted[:, :n])
        worst, A = np.vstack((worst, gain)), A + B @ gain
    change = slopes.swapaxes(1, 2) @ weighted
    change = worst.T @ (change + change.swapaxes(1, 2)) @ worst
    solutions = [cost_to_go(A, Q) for Q in change]
    return None if any(X is None for X in solutions) else np.array(solutions)


def _margin(rest: Array, P: Array, level: float) -> float:
    """Return by which part of diag(P, level^2) the form may grow if M differs by twice ``rest``.

    In units in which diag(P, 1) and diag(P, level^2) are the identity, M is at most 1 in norm.
    """
    n, unit = len(P), _units(P)
    values, vectors = np.linalg.eigh(_scaled(P, P))
    root = np.sqrt(np.maximum(values, 1e-14 * values[-1]))
    left, right = (vectors * root).T / unit, vectors / root * unit[:, np.newaxis]
    rest = np.concatenate((left @ rest[:, :n], rest[:, n:]), axis=1)
    rest = np.concatenate((rest[:, :, :n] @ right, rest[:, :, n:] / level), axis=2)
    size = SAFETY * float(np.linalg.norm(rest, 2, axis=(1, 2)).max(initial=0.0))
    return 2.0 * size + size**2


def _form(M: Array, P: Array, floor: Array, level: float, margin: float) -> Array:
    """Return M'diag(P, 1) M - (1 - margin) diag(P, level^2) + diag(floor, 0) at nodes."""
    n = P.shape[1]
    weighted = np.concatenate((P @ M[:, :n], M[:, n:]), axis=1)
    form: Array = M.swapaxes(1, 2) @ weighted
    form[:, :n, :n] += floor - (1.0 - margin) * P
    inputs = np.arange(n, form.shape[1])
    form[:, inputs, inputs] -= (1.0 - margin) * level**2 if inputs.size else 0.0
    return form


def _excess(form: Array, n: int) -> Array | None:
    """Return the Schur complement (N, n, n) of the inputs, None if they are not bounded."""
    inner = -form[:, n:, n:]
    if not inner.size:
        return form
    if np.linalg.eigvalsh(inner).min() <= 0.0:
        return None
    cross = form[:, :n, n:]
    return np.asarray(form[:, :n, :n] + cross @ np.linalg.solve(inner, cross.swapaxes(1, 2)))


def _cover(matrices: Array, least: Array, P: Array) -> Array:
    """Return a matrix that is at least each of the symmetric matrices (N, n, n), and ``least``.

    Positive parts are added of the matrix that lacks most, a few times, then a multiple of the
    identity in the units of ``P``.
    """
    cover, matrices = _scaled(least, P), _scaled(matrices, P)
    for _ in range(_COVERED):
        values, vectors = np.linalg.eigh(matrices - cover)
        worst = int(np.argmax(values[:, -1]))
        positive = values[worst] > 0.0
        if not positive.any():
            break
        V = vectors[worst][:, positive]
        cover = np.asarray(cover + (V * values[worst, positive]) @ V.T)
        matrices = matrices[values[:, -1] > 0.0]
    lacking = float(np.linalg.eigvalsh(matrices - cover)[:, -1].max())
    cover = cover + max(lacking, 0.0) * np.eye(len(P))
    unit = _units(P)
    return np.asarray(cover / (unit * unit[:, np.newaxis]))


def _scaled(X: Array, P: Array) -> Array:
    """Return X with its states in units in which the diagonal of P is one."""
    unit = _units(P)
    return np.asarray(X * unit * unit[:, np.newaxis])


def _units(P: Array) -> Array:
    return np.asarray(1.0 / np.sqrt(np.maximum(P.diagonal(), 1e-300)))
