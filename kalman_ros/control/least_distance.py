# SPDX-License-Identifier: Apache-2.0
"""The quadratic program of predictive control: the shortest vector within linear limits.

    minimise |z|^2 + sum of s_i^2 / d_i  with  A z <= b + s,  s_i = 0 where d_i = 0

A limit with d_i > 0 is soft: it may be exceeded at a price. The dual problem is one of
non-negative least squares (C. Lawson and R. Hanson, Solving Least Squares Problems, 1974, chapter
23), which scipy solves. Of many limits few act, so it is solved for the likely ones, and those
that its solution exceeds are added, until there are none.

With the package ``daqp`` installed, its solver in C is used (D. Arnstrom, A. Bemporad and D.
Axehed, A Dual Active-Set Solver for Embedded Quadratic Programming Using Recursive LDL' Updates,
IEEE Transactions on Automatic Control 67, 2022); the answers agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear.lapack import dposv, dpotrs

#: A limit is exceeded by more than this, relative to the larger of its bound and 1.
_EXCEEDED = 1e-9
#: No vector keeps the hard limits if the least squares leave less than this.
_INSIDE = 1e-9
#: How many limits are added at once, and how often.
_ADDED, _MOST = 30, 40
#: How often a limit is added or left out in the end, and when one is then exceeded.
_CORRECTIONS, _SURELY = 12, 1e-12
#: The tolerances of daqp, and how it marks rows.
_PRIMAL, _DUAL = 1e-10, 1e-12
_ACTIVE, _EQUAL, _SOFT = 1, 5, 8
#: Its multiplier below this, relative to the largest, is zero.
_ZERO = 1e-12
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
    try:
        import daqp
    except ImportError:
        return False
    return hasattr(daqp, 'solve')


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
        # rows of length 1, so that tolerances mean the same whatever the units
        lengths = np.linalg.norm(A, axis=1)
        self._lengths = np.where(lengths > 0.0, lengths, 1.0)
        self._A = np.ascontiguousarray(A / self._lengths[:, np.newaxis])
        self._softness = softness / self._lengths**2
        self._search: Any = self._by_least_squares
        if has_daqp() if compiled is None else compiled:
            self._search = _Daqp(self._A, self._softness)
            return
        from scipy.optimize import nnls  # slow to import

        self._nnls = nnls

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
        b = b / self._lengths
        size = float(np.abs(b[b < 0.0]).max())
        b = b / size
        z, rows = self._search(b, active, deadline)
        shortest = self._exact(b, rows, z)
        return Shortest(size * shortest.z, shortest.active)

    def _by_least_squares(
        self, b: Array, active: Sequence[int], deadline: float
    ) -> tuple[Array, list[int]]:
        """Return the vector, and the limits that act."""
        A = self._A
        z, likely, y = np.zeros(A.shape[1]), [*active], np.zeros(len(active))
        allowed = _EXCEEDED * np.maximum(np.abs(b), 1.0)
        for _ in range(_MOST):
            over = A @ z - b
            if y.any():  # soft limits among the likely ones may be exceeded at their price
                over[likely] = 0.0
            exceeded = np.flatnonzero(over > allowed)
            new = exceeded[np.argsort(-over[exceeded])][:_ADDED].tolist()
            if not new:
                return z, [row for row, value in zip(likely, y) if value > 0.0]
            if monotonic() > deadline:
                break
            likely = [*dict.fromkeys((*likely, *new))]
            rows = A[likely]
            E = np.vstack((-rows.T, np.diag(np.sqrt(self._softness[likely])), -b[likely]))
            f = np.zeros(len(E))
            f[-1] = 1.0
            try:
                y, left = self._nnls(E, f)
            except RuntimeError:
                break
            residual = E @ y - f
            if left < _INSIDE:
                raise InfeasibleError('no input keeps the limits')
            z = -residual[: A.shape[1]] / residual[-1]
        raise LateError('no solution in time')

    def _exact(self, b: Array, rows: list[int], z: Array) -> Shortest:
        """Return the solution, which the search has up to its tolerances.

        The limits that act are changed, one at a time, until no multiplier is negative and no
        other limit is exceeded; that is the solution (J. Nocedal and S. Wright, Numerical
        Optimization, 2006, theorem 16.4).
        """
        shortest, acting = Shortest(z, tuple(rows)), sorted(rows)
        for _ in range(_CORRECTIONS):
            if not acting:
                break
            try:
                exact, multipliers = self._at(b, acting)
            except np.linalg.LinAlgError:  # limits that depend on each other
                break
            least = int(multipliers.argmin())
            if multipliers[least] <= 0.0:
                del acting[least]
                continue
            over = self._A @ exact - b
            over[acting] = 0.0
            most = int(over.argmax())
            if over[most] <= _SURELY * max(abs(b[most]), 1.0):
                return Shortest(exact, tuple(acting))
            acting = sorted([*acting, most])
        return shortest

    def _at(self, b: Array, rows: list[int]) -> tuple[Array, Array]:
        """Return the shortest vector at these limits, and their multipliers.

        The rounding of the first solution is corrected, since the matrix has the squares of the
        limits (N. Higham, Accuracy and Stability of Numerical Algorithms, 2002, chapter 12).
        """
        index = np.array(rows)
        A, bounds, softness = self._A[index], b[index], self._softness[index]
        M = A @ A.T
        M.flat[:: len(rows) + 1] += softness
        factor, multipliers, failed = dposv(M, -bounds)
        if failed:
            raise np.linalg.LinAlgError('the matrix is singular')
        z = -multipliers @ A
        correction, _ = dpotrs(factor, A @ z - softness * multipliers - bounds)
        multipliers = multipliers + correction
        return -multipliers @ A, multipliers


class _Daqp:
    """The same problem, solved by daqp.

    It has one softness for all rows, of length 1 each: a variable that is zero, of which each row
    has as much as it needs, makes them so.
    """

    def __init__(self, A: Array, softness: Array) -> None:
        soft = softness > 0.0
        squares = np.sum(A * A, axis=1)
        felt = soft & (squares > 0.0)
        self._softness = float((softness[felt] / squares[felt]).min()) if felt.any() else 1.0
        zero = np.zeros(len(A))
        zero[soft] = np.sqrt(np.maximum(softness[soft] / self._softness - squares[soft], 0.0))
        self._A = np.ascontiguousarray(np.column_stack((zero, A)))
        n = A.shape[1] + 1
        self._H, self._f = np.eye(n), np.zeros(n)
        self._none = np.append(0.0, np.full(len(A), -1e30))
        self._sense = np.append(_EQUAL, np.where(soft, _SOFT, 0)).astype(np.int32)

    def __call__(
        self, b: Array, active: Sequence[int], deadline: float
    ) -> tuple[Array, list[int]]:
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
        return np.asarray(z)[1:], np.flatnonzero(multipliers > _ZERO * size).tolist()
