# SPDX-License-Identifier: Apache-2.0
"""The worst of a loop over a box of parameters, from below and from above.

A sampled loop x' = A x + B w, z = C x + D w depends on constant parameters p. Let
M = [[A, B], [C, D]]. If it is stable at one p, and if some P(p) has

    M(p)' diag(P(p), 1) M(p) <= diag(P(p), g^2)

for all p in a box, then x'P x is a storage function of each of these loops: they are stable, and
|z| <= g |w| (J. Willems, Arch. Rational Mech. Anal. 45, 1972; S. Boyd et al., Linear Matrix
Inequalities in System and Control Theory, 1994, chapters 5 to 7). Without w the sum of |z|^2
from x on is at most x'P x. Here M is the polynomial of second degree in each
parameter through 3^d points of the box, and P is linear: that of the centre with its derivatives.
Both sides are then polynomials, which lie in the hull of their Bernstein coefficients (J. Garloff,
1986), and these are checked. The difference between M and its polynomial is measured where that of
a cubic is largest, and twice as much is allowed for. A box without such a P is halved.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import comb, inf, isfinite

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.optimize import brentq, minimize

from kalman_ros.core import Array, DesignError
from kalman_ros.linear.lyapunov import stationary_covariance
from kalman_ros.linear.matrices import symmetric

from .crossings import continuous
from .margins import peak
from .performance import NoisyLoop
from .state_space import StateSpace

#: The relative distance between the worst value that was found and the bound.
GAP = 0.08
#: The largest number of boxes that are looked at.
_MOST_BOXES = 1000
#: The largest multiple of a box in which a stability limit is searched.
MOST_TIMES = 4.0
#: Iterations for a storage function, and how much larger than the differences it is made.
_ITERATIONS, _MARGIN = 40, 1.05
#: How often a stability limit is lowered until it can be proved.
_ATTEMPTS = 6
#: Share of the cost that is added so that a storage function proves stability, too.
_FLOOR = 1e-3
#: Weight of a state, in units of its reach, that no bound depends on.
_TINY = 1e-7
#: Where a cubic differs most from its parabola, as a part of half the side of a box, and how many
#: times the difference there is allowed for.
_LARGEST, _SAFETY = 3.0**-0.5, 2.0
#: The degree in each parameter of M'P M, with M of second degree and P of first.
_DEGREE = 5
#: The part of the largest box with a loop in each corner that is searched.
_WITHIN = 0.95
#: Matrices whose positive parts make up a cover.
_COVERED = 4
#: Poles beyond count as unstable.
_STABLE = 1.0 - 1e-9
#: Random directions in which a stability limit is searched, in addition to the corners.
_DIRECTIONS = 32


@dataclass(frozen=True)
class Bracket:
    """The largest value over a box of parameters.

    Parameters
    ----------
    reached
        The largest value that was found; infinite if a loop is unstable.
    bound
        No point of the box has more; infinite if nothing was proved.
    point
        Parameters (d,) at which it was found.
    """

    reached: float
    bound: float
    point: Array


@dataclass(frozen=True)
class StabilityLimit:
    """How far a box can be scaled about the nominal parameters before a loop becomes unstable.

    Its inverse is the peak of the structured singular value for these real parameters (R. de
    Gaston and M. Safonov, IEEE Trans. Automatic Control 33(2), 1988).

    Parameters
    ----------
    proved
        All loops in a box this many times as large are stable.
    refuted
        A box this many times as large has an unstable loop; infinite if none was found.
    point
        Parameters (d,) at which that loop is; None if there is none.
    """

    proved: float
    refuted: float
    point: Array | None

    @property
    def structured_singular_value(self) -> tuple[float, float]:
        """Its lower and upper bound."""
        return 1.0 / self.refuted, 1.0 / self.proved if self.proved else inf


class _Family(ABC):
    """Loops that depend on parameters, and what is the worst of them."""

    @abstractmethod
    def value(self, at: Array) -> float:
        """Return the value at parameters (d,)."""

    @abstractmethod
    def matrices(self, at: Array) -> Array:
        """Return the numbers (k,) that a bound depends on, smooth in the parameters."""

    @abstractmethod
    def bound(self, grid: Array, rest: Array, level: float) -> float:
        """Return a bound of the values in a box, inf if above ``level``.

        Its matrices at the corners, the middles of the sides and the centre are (3, ..., 3, k),
        and ``rest`` (K, k) is by how much others differ from the polynomial through these.
        """


class _Costs(_Family):
    """The mean of |z|^2 of loops that noise drives."""

    def __init__(self, loop: Callable[[Array], NoisyLoop]) -> None:
        self._loop = loop

    def value(self, at: Array) -> float:
        loop = self._loop(at)
        covariance = _lyapunov(loop.A.T, loop.noise)
        if covariance is None:
            return inf
        return float(np.einsum('ij,jk,ik', loop.C, covariance, loop.C)) + loop.direct

    def matrices(self, at: Array) -> Array:
        loop = self._loop(at)
        self._n = n = len(loop.A)
        assert loop.C.shape[1] == n
        return np.concatenate((loop.A.ravel(), loop.C.ravel(), loop.noise.ravel(), [loop.direct]))

    def bound(self, grid: Array, rest: Array, level: float) -> float:
        n, d = self._n, grid.ndim - 1
        M, M_rest = (_square(some[..., : -n * n - 1], n) for some in (grid, rest))
        noise_rest = _square(rest[:, -n * n - 1 : -1], n)
        noise = _nodes(_square(grid[..., -n * n - 1 : -1], n), d)
        direct = _nodes(grid[..., -1], d)
        floor = _floor(_centre(M, d), noise.mean(axis=0))

        def cost(P: Array) -> float:
            most = _coefficients(np.einsum('kij,kji->k', P, noise) + direct, d).max()
            left = np.einsum('ij,kji->k', P.mean(axis=0), noise_rest) + rest[:, -1]
            return float(most + _SAFETY * np.abs(left).max(initial=0.0))

        P = None if floor is None else _storage(M, M_rest, inf, floor, lambda P: cost(P) <= level)
        return inf if P is None else cost(P)


class _Peaks(_Family):
    """The largest gain max|z| / |w| of loops with one input and one output."""

    def __init__(self, loop: Callable[[Array], StateSpace]) -> None:
        self._loop = loop

    def value(self, at: Array) -> float:
        loop = self._loop(at)
        return peak(continuous(loop))[0] if loop.stable else inf

    def matrices(self, at: Array) -> Array:
        loop = self._loop(at)
        self._n = len(loop.A)
        return np.asarray(np.block([[loop.A, loop.B], [loop.C, loop.D]])).ravel()

    def bound(self, grid: Array, rest: Array, level: float) -> float:
        n, M = self._n, _square(grid, self._n + 1)
        A, B = np.split(_centre(M, grid.ndim - 1)[:n], [n], axis=1)
        reach = _lyapunov(A.T, B @ B.T)
        if reach is None:
            return inf
        # some weight of every state, since neither input nor output may reach it
        spread = reach.diagonal().copy()
        spread[spread <= _TINY * spread.max()] = spread.max() or 1.0
        floor = np.diag(_TINY * level**2 / spread)
        return inf if _storage(M, _square(rest, n + 1), level, floor) is None else level


def worst_cost(loop: Callable[[Array], NoisyLoop], low: Array, high: Array) -> Bracket:
    """Return the largest `NoisyLoop.cost` over parameters from ``low`` to ``high`` (d,)."""
    return _largest(_Costs(loop), low, high)


def worst_peak(loop: Callable[[Array], StateSpace], low: Array, high: Array) -> Bracket:
    """Return the largest gain of scalar sampled systems over parameters (d,)."""
    return _largest(_Peaks(loop), low, high)


def stability_limit(
    loop: Callable[[Array], NoisyLoop], nominal: Array, low: Array, high: Array
) -> StabilityLimit:
    """Return how many times as large a box may be before it has an unstable loop.

    Parameters
    ----------
    loop
        The loop at parameters (d,); ValueError where there is none, which ends the search.
    nominal
        Parameters within the box; their loop is stable.
    low, high
        Ends of the box.
    """

    def at(times: float, direction: Array) -> Array:
        part = np.where(direction < 0.0, nominal - low, high - nominal)
        return np.asarray(nominal + times * direction * part)

    most = _allowed(loop, at, len(nominal))
    refuted, point = _nearest_unstable(loop, at, len(nominal), most)
    proved, ones = most if refuted == inf else refuted, np.ones(len(nominal))
    for _ in range(_ATTEMPTS):
        if refuted != inf:
            proved /= 1.0 + GAP
        if _all_stable(loop, at(proved, -ones), at(proved, ones)):
            return StabilityLimit(proved, refuted, point)
        if refuted == inf:
            proved /= 1.0 + 2.0 * GAP
    return StabilityLimit(0.0, refuted, point)


def _largest(family: _Family, low: Array, high: Array) -> Bracket:
    """Return the largest value of a family over a box, by branch and bound."""
    known: dict[bytes, Array] = {}

    def matrices(at: Array) -> Array:
        key = at.tobytes()
        if key not in known:
            known[key] = family.matrices(at)
        return known[key]

    reached, point = _climbed(family, low, high)
    bound, boxes, scale = reached, [(low, high)], _sizes(matrices, low, high)
    for _ in range(_MOST_BOXES):
        if not boxes or not isfinite(reached):
            break
        first, last = boxes.pop()
        middle = 0.5 * (first + last)
        if (value := family.value(middle)) > reached:
            reached, point = value, middle
        least = family.bound(*_matrices(matrices, first, last), reached * (1.0 + GAP))
        if isfinite(least):
            bound = max(bound, least)
        else:
            boxes += _halves(matrices, first, last, scale)
    return Bracket(reached, max(bound, reached) if not boxes else inf, point)


def _climbed(family: _Family, low: Array, high: Array) -> tuple[float, Array]:
    """Return the largest value from corners, middles of sides and the centre on, and where."""
    middle = 0.5 * (low + high)
    points = [np.array(at) for at in product(*zip(low, middle, high))]
    values = [family.value(at) for at in points]
    best = int(np.argmax(values))
    if not isfinite(values[best]) or np.all(low == high):
        return values[best], points[best]
    half = np.where(high > low, 0.5 * (high - low), 1.0)
    found = minimize(
        lambda z: -min(family.value(np.clip(middle + half * z, low, high)), 1e300),
        (points[best] - middle) / half, method='Nelder-Mead',
        options={'maxfev': 40 * len(low), 'xatol': 1e-4, 'fatol': 1e-6 * values[best]},
    )  # fmt: skip
    at = np.clip(middle + half * found.x, low, high)
    value = family.value(at)
    return (value, at) if value > values[best] else (values[best], points[best])


def _matrices(matrices: Callable[[Array], Array], low: Array, high: Array) -> tuple[Array, Array]:
    """Return the matrices of a box, and by how much others differ from their polynomial.

    Returns
    -------
    grid
        Matrices (3, ..., 3, k) at the corners, middles of the sides, and the centre.
    rest
        Differences (K, k) at the points at which that of a cubic is largest.
    """
    d, middle, half = len(low), 0.5 * (low + high), 0.5 * (high - low)
    around = np.array(list(product((-1.0, 0.0, 1.0), repeat=d)))
    grid, inner = (
        np.array([matrices(middle + half * part * at) for at in around])
        for part in (1.0, _LARGEST)
    )
    grid = grid.reshape(*(3,) * d, -1)
    t = 0.5 + 0.5 * _LARGEST * np.array([-1.0, 0.0, 1.0])
    return grid, inner - _along_axes(_quadratic(t), grid, d)


def _sizes(matrices: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Return the largest sizes (k,) of the numbers at the corners and the centre of a box."""
    points = [np.array(at) for at in product(*zip(low, high))] + [0.5 * (low + high)]
    return np.asarray(np.abs([matrices(at) for at in points]).max(axis=0) + 1e-300)


def _halves(
    matrices: Callable[[Array], Array], low: Array, high: Array, scale: Array
) -> list[tuple[Array, Array]]:
    """Return the halves of a box across the side along which its matrices change most.

    Numbers count in units of ``scale`` (k,), their sizes in the whole box.
    """
    middle, change = 0.5 * (low + high), []
    for axis in range(len(low)):
        first, last = middle.copy(), middle.copy()
        first[axis], last[axis] = low[axis], high[axis]
        change.append(float(np.linalg.norm((matrices(last) - matrices(first)) / scale)))
    axis = int(np.argmax(change))
    below, above = high.copy(), low.copy()
    below[axis] = above[axis] = middle[axis]
    return [(low, below), (above, high)]


def _storage(
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
    n, d = len(floor), grid.ndim - 2
    centre, slopes, M = _centre(grid, d), _slopes(grid, d), _nodes(grid, d)
    at = np.array(list(product(np.linspace(-1.0, 1.0, _DEGREE + 1), repeat=d)))
    E = np.zeros((n, n))
    for _ in range(_ITERATIONS):
        P = _solution(centre, level, floor + E)
        change = None if P is None else _derivatives(centre, slopes, P, level)
        if P is None or change is None:
            return None
        at_nodes = P + np.tensordot(at, change, 1)
        if not enough(at_nodes):
            return None
        margin = _margin(rest, P, level)
        excess = _excess(_coefficients(_form(M, at_nodes, floor, level, margin), d), n)
        if excess is None:
            return None
        lacking = np.linalg.eigvalsh(_scaled(excess, P))[:, -1] > 0.0
        if not lacking.any():
            return at_nodes
        E = _cover(_MARGIN * (excess[lacking] + E), E, P)
    return None


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
    size = _SAFETY * float(np.linalg.norm(rest, 2, axis=(1, 2)).max(initial=0.0))
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
    solutions = [_lyapunov(A, Q) for Q in change]
    return None if any(X is None for X in solutions) else np.array(solutions)


def _lyapunov(A: Array, Q: Array) -> Array | None:
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
        P = _lyapunov(A, Q)
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


def _centre(grid: Array, d: int) -> Array:
    return np.asarray(grid[(1,) * d])


def _slopes(grid: Array, d: int) -> Array:
    """Return half the differences (d, ...) between opposite sides of a box."""
    middle = [1] * d
    ends = [[(*middle[:axis], end, *middle[axis + 1 :]) for end in (0, 2)] for axis in range(d)]
    return np.array([0.5 * (grid[high] - grid[low]) for low, high in ends])


def _square(numbers: Array, columns: int) -> Array:
    """Return matrices (..., rows, columns) of numbers (..., k)."""
    return numbers.reshape(*numbers.shape[:-1], -1, columns)


def _nodes(grid: Array, d: int) -> Array:
    """Return at equidistant nodes (N, ...) the polynomial through the points of a grid."""
    t = np.linspace(0.0, 1.0, _DEGREE + 1)
    return _along_axes(_quadratic(t), grid, d)


def _quadratic(t: Array) -> Array:
    """Return the values at t (N,) of the polynomials that are 1 at one of 0, 1/2, 1 (N, 3)."""
    return np.stack(((1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)), 1)


def _coefficients(values: Array, d: int) -> Array:
    """Return the Bernstein coefficients (N, ...) of a polynomial with values at nodes (N, ...)."""
    t = np.linspace(0.0, 1.0, _DEGREE + 1)
    basis = np.stack(
        [comb(_DEGREE, k) * t**k * (1.0 - t) ** (_DEGREE - k) for k in range(_DEGREE + 1)], 1
    )
    grid = values.reshape(*(len(t),) * d, *values.shape[1:])
    return _along_axes(np.asarray(np.linalg.inv(basis), dtype=float), grid, d)


def _along_axes(matrix: Array, values: Array, d: int) -> Array:
    """Return values (N, ...) after a matrix along each of the first ``d`` axes."""
    for axis in range(d):
        values = np.moveaxis(np.tensordot(matrix, values, (1, axis)), 0, axis)
    return np.asarray(values).reshape(-1, *values.shape[d:])


def _scaled(X: Array, P: Array) -> Array:
    """Return X with its states in units in which the diagonal of P is one."""
    unit = _units(P)
    return np.asarray(X * unit * unit[:, np.newaxis])


def _units(P: Array) -> Array:
    return np.asarray(1.0 / np.sqrt(np.maximum(P.diagonal(), 1e-300)))


def _floor(M: Array, noise: Array) -> Array | None:
    """Return what makes x'P x decrease in all states: about a thousandth of the cost."""
    n = len(noise)
    A, C = M[:n], M[n:]
    covariance = _lyapunov(A.T, noise)
    if covariance is None:
        return None
    spread = covariance.diagonal()
    covariance = covariance + np.diag(1e-6 * spread + 1e-12 * max(spread.max(), 1e-300))
    cost = float(np.einsum('ij,jk,ik', C, covariance, C)) or 1.0
    inverse: Array = np.asarray(np.linalg.inv(covariance), dtype=float)
    return symmetric(_FLOOR * cost / n * inverse)


def _all_stable(loop: Callable[[Array], NoisyLoop], low: Array, high: Array) -> bool:
    """Return whether all loops of a box are stable, as far as can be proved."""

    def matrices(at: Array) -> Array:
        return loop(at).A.ravel()

    boxes, scale = [(low, high)], _sizes(matrices, low, high)
    for _ in range(_MOST_BOXES):
        if not boxes:
            return True
        first, last = boxes.pop()
        middle = loop(0.5 * (first + last))
        n = len(middle.A)
        floor = _floor(middle.A, middle.noise)
        if floor is None:
            return False
        grid, rest = (_square(some, n) for some in _matrices(matrices, first, last))
        if _storage(grid, rest, inf, floor) is None:
            boxes += _halves(matrices, first, last, scale)
    return False


def _allowed(
    loop: Callable[[Array], NoisyLoop], at: Callable[[float, Array], Array], d: int
) -> float:
    """Return how many times as large the box may be before there is no loop in a corner."""

    def allowed(times: float) -> bool:
        try:
            for corner in product((-1.0, 1.0), repeat=d):
                loop(at(times, np.array(corner)))
        except (ValueError, DesignError):
            return False
        return True

    if allowed(MOST_TIMES):
        return MOST_TIMES
    low, high = 0.0, MOST_TIMES
    while high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return _WITHIN * low  # at its very end a model may be singular


def _nearest_unstable(
    loop: Callable[[Array], NoisyLoop], at: Callable[[float, Array], Array], d: int, most: float
) -> tuple[float, Array | None]:
    """Return the least multiple of a box at which an unstable loop was found, and where."""

    def growth(times: float, direction: Array) -> float:
        try:
            A = loop(at(times, direction)).A
        except (ValueError, DesignError):
            return 1.0  # where there is no loop, it is not stable
        return float(np.abs(np.linalg.eigvals(A)).max()) - 1.0

    def crossing(direction: Array, most: float) -> float:
        """Return the least multiple up to ``most`` along a direction; beyond if there is none."""
        last = 0.0
        for times in np.linspace(0.0, most, 17)[1:].tolist():
            if growth(times, direction) >= 0.0:
                return float(brentq(growth, last, times, args=(direction,), xtol=1e-6 * most))
            last = times
        return most * (1.0 - min(growth(most, direction), 0.0))

    random = np.random.default_rng(0).uniform(-1.0, 1.0, (_DIRECTIONS if d > 1 else 0, d))
    directions = [np.array(c) for c in product((-1.0, 0.0, 1.0), repeat=d) if any(c)]
    directions += [direction / np.abs(direction).max() for direction in random]
    best, towards = most, directions[0]
    for direction in directions:
        if (times := crossing(direction, best)) <= best:
            best, towards = times, direction

    def nearest(z: Array) -> float:
        return crossing(z / max(np.abs(z).max(), 1e-9), most)

    if d > 1:
        found = minimize(nearest, towards, method='Nelder-Mead', options={'maxfev': 60 * d})
        if found.fun < best:
            best, towards = float(found.fun), found.x / np.abs(found.x).max()
    if best >= most:
        return inf, None
    return best, at(best, towards)
