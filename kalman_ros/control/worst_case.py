# SPDX-License-Identifier: Apache-2.0
"""The worst of a loop over a box of parameters, from below and from above.

The worst value is searched, and bounded by branch and bound: a box of parameters is done if one
`storage_function` proves that none of its loops is worse than what was found, by a small gap. Else
it is halved.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import inf, isfinite

import numpy as np
from scipy.optimize import brentq, minimize

from kalman_ros.core import Array, DesignError
from kalman_ros.linear.bernstein import at_nodes, centre, coefficients, polynomial

from .crossings import continuous
from .margins import peak
from .performance import NoisyLoop
from .state_space import StateSpace
from .storage import SAFETY, cost_to_go, decrease, storage_function

#: The relative distance between the worst value that was found and the bound.
GAP = 0.08
#: The largest numbers of boxes that are looked at, for a bound, and to prove a box stable.
_MOST_BOXES, _MOST_STABLE = 1000, 300
#: The largest multiple of a box in which a stability limit is searched.
MOST_TIMES = 4.0
#: How often a stability limit is lowered until it can be proved.
_ATTEMPTS = 6
#: Weight of a state, in units of its reach, that no bound depends on.
_TINY = 1e-7
#: The part of the largest box with a loop in each corner that is searched.
_WITHIN = 0.95
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
        covariance = cost_to_go(loop.A.T, loop.noise)
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
        noise = at_nodes(_square(grid[..., -n * n - 1 : -1], n), d)
        direct = at_nodes(grid[..., -1], d)
        floor = decrease(centre(M, d), noise.mean(axis=0))

        def cost(P: Array) -> float:
            most = coefficients(np.einsum('kij,kji->k', P, noise) + direct, d).max()
            left = np.einsum('ij,kji->k', P.mean(axis=0), noise_rest) + rest[:, -1]
            return float(most + SAFETY * np.abs(left).max(initial=0.0))

        P = (
            None
            if floor is None
            else storage_function(M, M_rest, inf, floor, lambda P: cost(P) <= level)
        )
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
        A, B = np.split(centre(M, grid.ndim - 1)[:n], [n], axis=1)
        reach = cost_to_go(A.T, B @ B.T)
        if reach is None:
            return inf
        # some weight of every state, since neither input nor output may reach it
        spread = reach.diagonal().copy()
        spread[spread <= _TINY * spread.max()] = spread.max() or 1.0
        floor = np.diag(_TINY * level**2 / spread)
        return inf if storage_function(M, _square(rest, n + 1), level, floor) is None else level


def worst_cost(loop: Callable[[Array], NoisyLoop], low: Array, high: Array) -> Bracket:
    """Return the largest `NoisyLoop.cost` over parameters from ``low`` to ``high`` (d,)."""
    return _largest(_Costs(loop), low, high)


def worst_peak(loop: Callable[[Array], StateSpace], low: Array, high: Array) -> Bracket:
    """Return the largest gain of scalar sampled systems over parameters (d,)."""
    return _largest(_Peaks(loop), low, high)


def stability_limit(
    loop: Callable[[Array], NoisyLoop],
    nominal: Array,
    low: Array,
    high: Array,
    unstable: Sequence[Array] = (),
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
    unstable
        Parameters that are known to have an unstable loop.
    """

    def at(times: float, direction: Array) -> Array:
        part = np.where(direction < 0.0, nominal - low, high - nominal)
        return np.asarray(nominal + times * direction * part)

    most = _allowed(loop, at, len(nominal))
    refuted, point = _nearest_unstable(loop, at, len(nominal), most)
    for known in unstable:
        part = np.where(known < nominal, nominal - low, high - nominal)
        gone = np.abs(known - nominal)
        times = float(np.max(gone / np.where(part > 0.0, part, 1.0)))
        if times < refuted:
            refuted, point = times, known
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
        least = family.bound(*polynomial(matrices, first, last), reached * (1.0 + GAP))
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
    optimum = minimize(
        lambda z: -min(family.value(np.clip(middle + half * z, low, high)), 1e300),
        (points[best] - middle) / half, method='Nelder-Mead',
        options={'maxfev': 40 * len(low), 'xatol': 1e-4, 'fatol': 1e-6 * values[best]},
    )  # fmt: skip
    at = np.clip(middle + half * optimum.x, low, high)
    value = family.value(at)
    return (value, at) if value > values[best] else (values[best], points[best])


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


def _square(numbers: Array, columns: int) -> Array:
    """Return matrices (..., rows, columns) of numbers (..., k)."""
    return numbers.reshape(*numbers.shape[:-1], -1, columns)


def _all_stable(loop: Callable[[Array], NoisyLoop], low: Array, high: Array) -> bool:
    """Return whether all loops of a box are stable, as far as can be proved."""

    def matrices(at: Array) -> Array:
        return loop(at).A.ravel()

    boxes, scale = [(low, high)], _sizes(matrices, low, high)
    for _ in range(_MOST_STABLE):
        if not boxes:
            return True
        first, last = boxes.pop()
        middle = loop(0.5 * (first + last))
        n = len(middle.A)
        floor = decrease(middle.A, middle.noise)
        if floor is None:
            return False
        grid, rest = (_square(some, n) for some in polynomial(matrices, first, last))
        if storage_function(grid, rest, inf, floor) is None:
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
        optimum = minimize(nearest, towards, method='Nelder-Mead', options={'maxfev': 60 * d})
        if optimum.fun < best:
            best, towards = float(optimum.fun), optimum.x / np.abs(optimum.x).max()
    if best >= most:
        return inf, None
    return best, at(best, towards)
