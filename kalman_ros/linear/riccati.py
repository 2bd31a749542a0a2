# SPDX-License-Identifier: Apache-2.0
"""The algebraic Riccati equations, with a reason where they have no stabilising solution.

A regulator and an estimator have the same equations, for (A, B, Q, R, N) and for their duals
(A', C', W, V, N). All units are scaled away before scipy's solvers see them: inputs by the
diagonal of R, states by what balances the Hamiltonian, the solution by what balances its two
off-diagonal blocks, and time by the size of all.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .errors import DesignError
from .matrices import Array, solve, symmetric
from .structure import ComplexArray, describe_distinct, eigenvalues, uncontrollable_modes, unstable

#: A sampled pole this close to 1 is 1 except for rounding.
_ENDLESS = 1e-9
#: An eigenvalue of R, with a diagonal of ones, below this is zero except for rounding.
_SINGULAR = 1e-13
#: Weights and variances outside this range are refused; their squares would overflow.
_SMALLEST, _LARGEST = 1e-100, 1e100
#: Newton's steps; each doubles the correct digits, and the solvers give half of them or more.
_STEPS = 8
#: Iteration ends when a step changes the solution by less, relative to its diagonal.
_EXACT = 1e-13
#: A solution that still changes by more has not converged.
_LOST = 1e-6
#: A diagonal element below this, relative to the largest, may be rounding: a sum of squares has
#: more correct digits than a solution of Lyapunov's equation.
_ROUNDING = {True: 1e-15, False: 1e-8}
#: The residual of the equation that rounding may leave, relative to what its terms are summed of.
_RESIDUAL = 1e-12
#: Doublings of a sum along a closed loop, enough for its slowest pole.
_DOUBLINGS = 64


class Terms(NamedTuple):
    """How errors name the parts of a problem."""

    weight: str
    state_weight: str
    out_of_reach: str
    weightless: str


CONTROL = Terms(
    'input_cost',
    'state_cost',
    'no input can stabilise the modes at',
    'the least-cost gain does not stabilise the system: some mode that does not decay has no '
    'weight in state_cost',
)
ESTIMATION = Terms(
    'noise of the readings',
    'process noise',
    'no reading observes the modes at',
    'the error does not decay: some mode that stays has no process noise, so that the filter '
    'ends up ignoring its readings',
)


@dataclass(frozen=True)
class Solution:
    """A stabilising solution.

    Parameters
    ----------
    S
        The symmetric positive semi-definite solution (n, n).
    K
        The gain (m, n) of that solution.
    poles
        Eigenvalues of A - B K (n,), all stable.
    """

    S: Array
    K: Array
    poles: ComplexArray


@dataclass(frozen=True)
class _Problem:
    """A Riccati equation in scaled units; see `_scaled`."""

    A: Array
    B: Array
    Q: Array
    R: Array
    N: Array

    def closed(self, K: Array) -> tuple[Array, Array]:
        """Return A - B K, and the weight of the state with u = -K x: a sum of squares."""
        NK = self.N @ K
        return self.A - self.B @ K, symmetric(self.Q + K.T @ self.R @ K - NK - NK.T)

    def residual(self, S: Array, K: Array, *, sampled: bool) -> float:
        """Return by how much S is not the cost of the gain K.

        It is relative to the largest of the terms before anything in them cancels: a closed loop
        A - B K that is small is the difference of two that are not.
        """
        closed, weight = self.closed(K)
        moved = S @ closed
        terms = (closed.T @ moved, -S, weight) if sampled else (moved, moved.T, weight)
        open_too = np.abs(self.A) + np.abs(self.B) @ np.abs(K)
        summed = np.abs(S) @ open_too
        sizes = [np.abs(weight), *((open_too.T @ summed, np.abs(S)) if sampled else (summed,))]
        largest = max(float(size.max(initial=0.0)) for size in sizes)
        return float(np.abs(sum(terms)).max(initial=0.0)) / (largest or 1.0)


@dataclass(frozen=True)
class _Units:
    """The units of a scaled problem: states (n,), inputs (m,), cost and, if continuous, rates."""

    states: Array
    inputs: Array
    cost: float
    rate: float

    def restore(self, S: Array, K: Array) -> tuple[Array, Array]:
        """Return a solution and its gain in the units of the problem as it was given."""
        S = self.cost * S / np.outer(self.states, self.states)
        return S, self.inputs[:, np.newaxis] * K / self.states


def continuous(A: Array, B: Array, Q: Array, R: Array, N: Array, terms: Terms) -> Solution:
    """Return S of A'S + S A - (S B + N) R^-1 (B'S + N') + Q = 0, and K = R^-1 (B'S + N').

    Raises
    ------
    DesignError
        If R is not positive definite, or no stabilising solution exists.
    """
    # slow to import, so only for a design
    from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

    def gain(p: _Problem, S: Array) -> Array:
        return solve(p.R, p.B.T @ S + p.N.T)

    def refine(p: _Problem, K: Array) -> Array:
        closed, weight = p.closed(K)
        return symmetric(solve_continuous_lyapunov(closed.T, -weight))

    return _solution((A, B, Q, R, N), terms, (solve_continuous_are, gain, refine), sampled=False)


def discrete(F: Array, G: Array, Q: Array, R: Array, N: Array, terms: Terms) -> Solution:
    """Return S of F'S F - S - (F'S G + N) (R + G'S G)^-1 (G'S F + N') + Q = 0.

    Its gain is K = (R + G'S G)^-1 (G'S F + N').

    Raises
    ------
    DesignError
        If neither R nor R + G'W G is positive definite, W the cost of a state without an input,
        or no stabilising solution exists.
    """
    from scipy.linalg import solve_discrete_are

    def gain(p: _Problem, S: Array) -> Array:
        return solve(p.R + p.B.T @ S @ p.B, p.B.T @ S @ p.A + p.N.T)

    def refine(p: _Problem, K: Array) -> Array:
        return stein(*p.closed(K))

    return _solution((F, G, Q, R, N), terms, (solve_discrete_are, gain, refine), sampled=True)


def stein(A: Array, W: Array) -> Array:
    """Return S = A'S A + W of a stable A: the sum of A'^k W A^k, by doubling (R. Smith, 1968).

    For a positive semi-definite W nothing cancels, so small elements are as accurate as large
    ones.
    """
    S = symmetric(W)
    for _ in range(_DOUBLINGS):
        more = A.T @ S @ A
        S, A = symmetric(S + more), A @ A
        d = np.sqrt(np.maximum(S.diagonal(), 0.0))
        if np.all(np.abs(more) <= np.finfo(float).eps * 1e-3 * np.outer(d, d)):
            break
    return S


Method = tuple[
    Callable[..., Array], Callable[[_Problem, Array], Array], Callable[[_Problem, Array], Array]
]


def _solution(
    given: tuple[Array, Array, Array, Array, Array], terms: Terms, method: Method, *, sampled: bool
) -> Solution:
    """Return scipy's solution in scaled units, refined by Newton's method.

    A step of Newton's method is the cost of the gain so far, a linear equation (D. Kleinman,
    IEEE Trans. Automatic Control 13(1), 1968; G. Hewer, 16(4), 1971).
    """
    first, gain, refine = method
    problem, units = _scaled(given, terms, sampled=sampled)
    S, K = np.zeros_like(problem.A), np.zeros_like(problem.B.T)
    settled = False
    try:
        with np.errstate(all='ignore'), warnings.catch_warnings():
            # a closed loop close to instability; its accuracy is checked below
            warnings.simplefilter('ignore', RuntimeWarning)
            S = symmetric(first(problem.A, problem.B, problem.Q, problem.R, s=problem.N))
            least, best = np.inf, S
            for _ in range(_STEPS):
                before, S = S, refine(problem, gain(problem, S))
                change = _change(before, S, _ROUNDING[sampled])
                if change < least:
                    least, best = change, S
                if not change > _EXACT:
                    break
            S = best  # that which rounding moved least
            K = gain(problem, S)
            settled = least <= _LOST and problem.residual(S, K, sampled=sampled) <= _RESIDUAL
            poles = units.rate * eigenvalues(problem.A - problem.B @ K)
            S, K = units.restore(_semidefinite(S), K)
    except (np.linalg.LinAlgError, ValueError):  # ValueError: not finite
        settled = False
    if settled and _stable(poles, sampled=sampled) and np.all(np.isfinite(S)):
        return Solution(S, K, poles)
    raise DesignError(_reason(given, problem, units, terms, sampled=sampled))


def _semidefinite(S: Array) -> Array:
    """Return S without the eigenvalues below zero that rounding leaves."""
    sizes, directions = np.linalg.eigh(S)
    if not sizes.size or sizes[0] >= 0.0:
        return S
    if sizes[0] < -_LOST * sizes[-1]:
        raise np.linalg.LinAlgError('not a covariance')
    root = directions * np.sqrt(np.maximum(sizes, 0.0))
    return symmetric(root @ root.T)


def _stable(poles: ComplexArray, *, sampled: bool) -> bool:
    decay = 1.0 - _ENDLESS - np.abs(poles) if sampled else -poles.real
    return bool(np.all(decay > 0.0))


def _change(before: Array, S: Array, rounding: float) -> float:
    """Return the largest change of an element, relative to the diagonal, as for a correlation."""
    d = np.sqrt(np.maximum(S.diagonal(), rounding * np.abs(S).max(initial=0.0)))
    scale = np.outer(d, d)
    if not np.all(np.isfinite(S)):
        return np.inf
    return float(np.max(np.abs(S - before) / np.where(scale > 0.0, scale, 1.0), initial=0.0))


def _scaled(
    given: tuple[Array, Array, Array, Array, Array], terms: Terms, *, sampled: bool
) -> tuple[_Problem, _Units]:
    """Return the problem in units in which its numbers are of one size, and those units.

    Raises
    ------
    DesignError
        If R is not positive definite, or badly scaled.
    """
    A, B, Q, R, N = given
    if not all(np.all(np.isfinite(part)) for part in (A, B, Q, N)):
        raise DesignError(f'system: expected finite matrices and {terms.state_weight}')
    # the least that weighs an input: its effect has the weight of the state in later samples
    weights = R + B.T @ _later(A, Q) @ B if sampled and _is_singular(R) else R
    variances = weights.diagonal()
    if not np.all(np.isfinite(R)) or not np.all((variances > _SMALLEST) & (variances < _LARGEST)):
        raise DesignError(
            f'{terms.weight}: expected a positive definite matrix with a diagonal between '
            f'{_SMALLEST:g} and {_LARGEST:g}, got the diagonal {_listed(variances)}'
        )
    units = 1.0 / np.sqrt(variances)
    weights = weights * np.outer(units, units)
    R, B, N = R * np.outer(units, units), B * units, N * units
    smallest = float(np.linalg.eigvalsh(symmetric(weights))[0]) if len(R) else 1.0
    if smallest < _SINGULAR:
        raise DesignError(
            f'{terms.weight}: expected a positive definite matrix, got one that is singular: its '
            f'smallest eigenvalue, with the diagonal scaled to 1, is {smallest:.3g}'
        )
    states = _state_units(A, B, Q)
    A, B = A * states / states[:, np.newaxis], B / states[:, np.newaxis]
    Q, N = Q * np.outer(states, states), N * states[:, np.newaxis]
    with np.errstate(over='ignore'):
        loaded, moved = np.linalg.norm(Q), np.linalg.norm(B) ** 2
    if not np.isfinite(loaded) or not np.isfinite(moved):
        raise DesignError(
            f'system: expected matrices and {terms.state_weight} whose squares are '
            f'finite, got elements up to {max(np.abs(Q).max(), np.abs(B).max()):.3g}'
        )
    size = float(np.sqrt(loaded / moved)) if loaded > 0.0 and moved > 0.0 else 1.0
    root = float(np.sqrt(size))
    B, Q, N = B * root, Q / size, N / root
    rate = 1.0 if sampled else _rate(A, Q)
    B, N, root = B / rate**0.5, N / rate**0.5, root * rate**0.5
    return _Problem(A / rate, B, Q / rate, R, N), _Units(states, units * root, size, rate)


def _later(A: Array, Q: Array) -> Array:
    """Return the cost of a state without an input, over as many samples as there are states."""
    total = moved = Q
    for _ in range(len(A) - 1):
        moved = A.T @ moved @ A
        total = total + moved
    return total


def _is_singular(R: Array) -> bool:
    """Return whether a weight is positive semi-definite only, whatever the units of its inputs."""
    if not np.all(np.isfinite(R)) or np.any(R.diagonal() < 0.0):
        return False
    units = 1.0 / np.sqrt(np.where(R.diagonal() > 0.0, R.diagonal(), 1.0))
    smallest = np.linalg.eigvalsh(symmetric(R * np.outer(units, units))).min(initial=1.0)
    return bool(-_SINGULAR < smallest < _SINGULAR)


def _rate(A: Array, Q: Array) -> float:
    """Return a power of four, the unit of time's inverse in which the Hamiltonian is near 1."""
    size = max(float(np.linalg.norm(part)) for part in (A, Q))
    return float(4.0 ** np.round(np.log2(size) / 2.0)) if size > 0.0 else 1.0


def _state_units(A: Array, B: Array, Q: Array) -> Array:
    """Return powers of two (n,), the units of the states that balance the Hamiltonian.

    The state and its costate have inverse units, which keeps the Hamiltonian one (P. Benner,
    Symplectic balancing of Hamiltonian matrices, SIAM J. Scientific Computing 22(5), 2001).
    """
    from scipy.linalg import matrix_balance

    n = len(A)
    with np.errstate(over='ignore', invalid='ignore'):
        sizes = np.abs(np.block([[A, B @ B.T], [Q, A.T]]))
        np.fill_diagonal(sizes, 0.0)
        if not np.all(np.isfinite(sizes)):  # refused by the caller
            return np.ones(n)
        _, (scale, _) = matrix_balance(sizes, permute=False, separate=True)
    powers = np.log2(scale)
    powers = 0.5 * (powers[:n] - powers[n:])
    return np.asarray(np.exp2(np.round(powers - powers.mean())))


def _reason(
    given: tuple[Array, Array, Array, Array, Array],
    problem: _Problem,
    units: _Units,
    terms: Terms,
    *,
    sampled: bool,
) -> str:
    """Return why there is no solution: an unreachable mode, one without weight, or the scale.

    A mode is one of those only if it is in the units of the problem and of the user alike.
    """
    A, B, Q, R, N = given
    pairs = (A, B), (problem.A * units.rate, B / units.states[:, np.newaxis])
    stuck = min((unstable(uncontrollable_modes(*p), sampled=sampled) for p in pairs), key=len)
    if stuck.size:
        return f'{terms.out_of_reach} {describe_distinct(stuck)}'
    silent = (
        uncontrollable_modes(free.T, weight / (np.abs(weight).max(initial=0.0) or 1.0))
        for free, weight in (_uncrossed(A, B, Q, R, N), _uncrossed(*vars(problem).values()))
    )
    if all(unstable(modes, sampled=sampled).size for modes in silent):
        return terms.weightless
    return (
        f'{terms.weight}: expected a size that can be weighed against the {terms.state_weight} '
        f'in double precision, got the diagonals {_listed(R.diagonal())} and '
        f'{_listed(Q.diagonal())}'
    )


def _uncrossed(A: Array, B: Array, Q: Array, R: Array, N: Array) -> tuple[Array, Array]:
    """Return A and Q once u = v - R^-1 N'x moves the cross weight into that of the state."""
    K = np.linalg.pinv(R) @ N.T
    return A - B @ K, Q - N @ K


def _listed(values: Array) -> str:
    return f'({", ".join(f"{value:.3g}" for value in values.tolist())})'
