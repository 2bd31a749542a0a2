# SPDX-License-Identifier: Apache-2.0
"""The quadratic program of predictive control: the shortest vector within linear limits.

    minimise |z|^2 + sum of s_i^2 / d_i  with  A z <= b + s,  s_i = 0 where d_i = 0

A limit with d_i > 0 is soft: it may be exceeded at a price. The dual active-set method of D.
Goldfarb and A. Idnani (A Numerically Stable Dual Method for Solving Strictly Convex Quadratic
Programs, Mathematical Programming 27, 1983), which starts from any set of limits, so that of the
step before is a good one. With the package ``daqp`` installed, its solver in C is used (D.
Arnstrom, A. Bemporad and D. Axehed, A Dual Active-Set Solver for Embedded Quadratic Programming
Using Recursive LDL' Updates, IEEE Transactions on Automatic Control 67, 2022); the answers agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from time import monotonic

import numpy as np
from scipy.linalg.lapack import dposv

from kalman_ros.core import Array

#: A limit may be exceeded by this much, relative to the larger of its bound and 1.
_TOLERANCE = 1e-9
#: A row that depends on the active ones leaves less than this of its square.
_DEPENDENT = 1e-10
#: A multiplier below this, relative to the largest, is zero.
_ZERO = 1e-12
#: The most limits that become active in one solution, for each row.
_MOST = 3
#: The tolerances of daqp, and how it marks rows.
_PRIMAL, _DUAL = 1e-10, 1e-12
_ACTIVE, _EQUAL, _SOFT = 1, 5, 8
#: The status of daqp for an infeasible problem, and for one that took too long.
_INFEASIBLE, _LATE = -1, (-4, -7)


class InfeasibleError(ValueError):
    """No vector is within the limits."""


class LateError(ValueError):
    """There was not enough time."""


@dataclass(frozen=True)
class Shortest:
    """The vector z (n,), and the limits that act on it, as indices."""

    z: Array
    active: tuple[int, ...]


def has_daqp() -> bool:
    """Return whether daqp is installed."""
    return find_spec('daqp') is not None


class LeastDistance:
    """The problem with given rows; only the bounds change.

    Parameters
    ----------
    A
        Rows (r, n).
    softness
        d (r,): 0 for a hard limit, else the inverse of its price.
    compiled
        Whether daqp solves it; by default where it is installed.
    """

    def __init__(self, A: Array, softness: Array, *, compiled: bool | None = None) -> None:
        self._A, self._softness = np.ascontiguousarray(A), softness
        self._solve = _Daqp(self._A, softness) if compiled or (
            compiled is None and has_daqp()
        ) else self._active_set  # fmt: skip

    def solve(self, b: Array, active: Sequence[int] = (), deadline: float = np.inf) -> Shortest:
        """Return the shortest vector.

        Parameters
        ----------
        b
            Bounds (r,).
        active
            The limits that are likely to act.
        deadline
            When to give up, by the monotonic clock.

        Raises
        ------
        InfeasibleError
            If no vector is within the limits.
        LateError
            If the deadline has passed.
        """
        if not (b < 0.0).any():
            return Shortest(np.zeros(self._A.shape[1]), ())
        return self._solve(b, active, deadline)

    def _active_set(self, b: Array, active: Sequence[int], deadline: float) -> Shortest:
        """Add the limit that is exceeded most to those that act, until none is exceeded."""
        rows, multipliers = self._start(b, [*active])
        allowed = _TOLERANCE * np.maximum(np.abs(b), 1.0)
        for _ in range(_MOST * len(b)):
            z = -multipliers @ self._A[rows]
            left = b - self._A @ z
            left[rows] = 0.0
            worst = int(np.argmin(left + allowed))
            if left[worst] >= -allowed[worst]:
                return Shortest(z, tuple(rows))
            if monotonic() > deadline:
                raise LateError('no solution in time')
            rows, multipliers = self._with(worst, float(left[worst]), rows, multipliers, b)
        raise LateError('no solution in as many steps')

    def _start(self, b: Array, rows: list[int]) -> tuple[list[int], Array]:
        """Return those of the limits that push, and their multipliers."""
        while rows:
            try:
                multipliers = _solved(self._products(rows), -b[rows])
            except np.linalg.LinAlgError:
                break
            if (multipliers > 0.0).all():
                return rows, multipliers
            rows = [row for row, value in zip(rows, multipliers) if value > 0.0]
        return [], np.zeros(0)

    def _with(
        self, added: int, left: float, rows: list[int], multipliers: Array, b: Array
    ) -> tuple[list[int], Array]:
        """Return the limits that act with another, which leaves ``left`` < 0, and multipliers.

        Its multiplier grows until the limit is kept; limits whose multipliers reach zero
        meanwhile act no more.
        """
        rows, pushed, row = [*rows], 0.0, self._A[added]
        square = float(row @ row) + float(self._softness[added])
        while True:
            common = self._A[rows] @ row
            change = _solved(self._products(rows), common) if rows else np.zeros(0)
            curvature = square - float(common @ change)
            falling = change > _ZERO
            ratios = np.full(len(rows), np.inf)
            ratios[falling] = multipliers[falling] / change[falling]
            blocked = float(ratios.min(initial=np.inf))
            depends = curvature <= _DEPENDENT * square
            kept = np.inf if depends else -left / curvature
            step = min(blocked, kept)
            if not step < np.inf:
                raise InfeasibleError('no input keeps the limits')
            pushed += step
            multipliers = multipliers - step * change
            left += step * max(curvature, 0.0)
            if step == kept:
                rows.append(added)
                exact = _solved(self._products(rows), -b[rows])  # without the rounding of steps
                return rows, exact if (exact > 0.0).all() else np.append(multipliers, pushed)
            first = int(np.argmin(ratios))
            del rows[first]
            multipliers = np.delete(multipliers, first)

    def _products(self, rows: list[int]) -> Array:
        """Return the products of rows with each other, and their softness on the diagonal."""
        A = self._A[rows]
        M: Array = A @ A.T
        M[np.diag_indices(len(rows))] += self._softness[rows]
        return M


class _Daqp:
    """The same problem, solved by daqp.

    It has one softness for all rows, of length 1 each: a variable that is zero, of which each row
    has as much as it needs, makes them so.
    """

    def __init__(self, A: Array, softness: Array) -> None:
        self._rows, self._softnesses = A, softness
        soft = softness > 0.0
        squares = np.sum(A * A, axis=1)
        self._softness = float((softness[soft] / squares[soft]).min()) if soft.any() else 1.0
        zero = np.zeros(len(A))
        zero[soft] = np.sqrt(np.maximum(softness[soft] / self._softness - squares[soft], 0.0))
        self._A = np.ascontiguousarray(np.column_stack((zero, A)))
        n = A.shape[1] + 1
        self._H, self._f = np.eye(n), np.zeros(n)
        self._none = np.append(0.0, np.full(len(A), -1e30))
        self._sense = np.append(_EQUAL, np.where(soft, _SOFT, 0)).astype(np.int32)

    def __call__(self, b: Array, active: Sequence[int], deadline: float) -> Shortest:
        import daqp

        sense = self._sense.copy()
        sense[[row + 1 for row in active]] |= _ACTIVE
        limit = 0.0 if np.isinf(deadline) else max(deadline - monotonic(), 1e-6)
        z, _, status, info = daqp.solve(
            self._H, self._f, self._A, np.append(0.0, b), self._none, sense, primal_tol=_PRIMAL,
            dual_tol=_DUAL, rho_soft=self._softness, time_limit=limit, eq_reduction=-1,
        )  # fmt: skip
        if status in _LATE:
            raise LateError('no solution in time')
        if status == _INFEASIBLE:
            raise InfeasibleError('no input keeps the limits')
        multipliers = np.asarray(info['lam'])[1:]
        size = np.abs(multipliers).max(initial=0.0)
        pushing = np.flatnonzero(multipliers > _ZERO * size).tolist()
        return self._exact(b, pushing, np.asarray(z)[1:])

    def _exact(self, b: Array, rows: list[int], z: Array) -> Shortest:
        """Return the solution where these limits act, without the tolerances of the search."""
        if not len(rows):
            return Shortest(z, ())
        A = self._rows[rows]
        M = A @ A.T
        M[np.diag_indices(len(rows))] += self._softnesses[rows]
        try:
            multipliers = _solved(M, -b[rows])
        except np.linalg.LinAlgError:
            return Shortest(z, tuple(rows))
        exact = -multipliers @ A
        return Shortest(exact if (multipliers > 0.0).all() else z, tuple(rows))


def _solved(M: Array, right: Array) -> Array:
    """Return the solution of M x = right with M positive definite."""
    _, x, failed = dposv(M, right)
    if failed:
        raise np.linalg.LinAlgError('the limits depend on each other')
    return np.asarray(x)
