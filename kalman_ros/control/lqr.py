# SPDX-License-Identifier: Apache-2.0
"""The linear-quadratic regulator, in continuous and in sampled time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kalman_ros.core import Array, ArrayLike, DesignError, LinearSystem, matrix, semidefinite
from kalman_ros.core import van_loan as integral
from kalman_ros.linear import riccati
from kalman_ros.linear.structure import ComplexArray, eigenvalues

#: A step of less than this share of the shortest time constant is one of continuous time.
_SHORT = 1e-6


@dataclass(frozen=True)
class Cost:
    """x'Q x + 2 x'N u + u'R u: Q (n, n), R (m, m), N (n, m)."""

    state: Array
    input: Array
    cross: Array

    @property
    def weight(self) -> Array:
        """The weight of the stacked vector (x, u): (n + m, n + m)."""
        return np.block([[self.state, self.cross], [self.cross.T, self.input]])


@dataclass(frozen=True)
class LqrDesign:
    """A state feedback u = -K x with the least cost.

    Parameters
    ----------
    gain
        K (m, n).
    cost_to_go
        S (n, n): the least cost from x on is x'S x.
    poles
        Eigenvalues of the closed loop (n,): of A - B K, or of F - G K when sampled.
    """

    gain: Array
    cost_to_go: Array
    poles: ComplexArray


def cost(
    state_cost: ArrayLike,
    input_cost: ArrayLike,
    size: tuple[int, int],
    cross_cost: ArrayLike | None = None,
    *,
    definite: bool = True,
) -> Cost:
    """Return checked weights for ``size`` = (n, m).

    Raises
    ------
    ValueError
        If ``state_cost`` is not symmetric positive semi-definite, ``input_cost`` not symmetric
        positive definite (or semi-definite, unless ``definite``), a size is wrong, or all three
        together are not positive semi-definite.
    """
    n, m = size
    Q = semidefinite('state_cost', state_cost, n)
    R = semidefinite('input_cost', input_cost, m, definite=definite)
    N = np.zeros((n, m)) if cross_cost is None else matrix('cross_cost', cross_cost, (n, m))
    if cross_cost is not None:
        semidefinite('cross_cost with state_cost and input_cost', Cost(Q, R, N).weight, n + m)
    return Cost(Q, R, N)


def lqr(A: Array, B: Array, weights: Cost) -> LqrDesign:
    """Return the gain that minimises the integral of the cost along dx/dt = A x + B u.

    K = R^-1 (B'S + N'), with S from the continuous Riccati equation (Anderson and Moore,
    Optimal Control: Linear Quadratic Methods, 1990, chapters 2 and 3).

    Raises
    ------
    DesignError
        If no gain stabilises the system with these weights, or ``input_cost`` is singular or of
        a size that cannot be weighed against ``state_cost``.
    """
    Q, R, N = weights.state, weights.input, weights.cross
    solution = riccati.continuous(A, B, Q, R, N, riccati.CONTROL)
    return LqrDesign(solution.K, solution.S, solution.poles)


def dlqr(F: Array, G: Array, weights: Cost) -> LqrDesign:
    """Return the gain that minimises the sum of the cost along x' = F x + G u.

    K = (R + G'S G)^-1 (G'S F + N'), with S from the discrete Riccati equation (same source,
    chapter 3). ``input_cost`` may be singular where ``state_cost`` weighs the input, a sample
    later.

    Raises
    ------
    DesignError
        If no gain stabilises the system with these weights, or ``input_cost`` is singular or of
        a size that cannot be weighed against ``state_cost``.
    """
    Q, R, N = weights.state, weights.input, weights.cross
    solution = riccati.discrete(F, G, Q, R, N, riccati.CONTROL)
    return LqrDesign(solution.K, solution.S, solution.poles)


def sampled_cost(system: LinearSystem, weights: Cost, dt: float) -> Cost:
    """Return the cost of one sample that equals the continuous cost over it.

    With the input held, (x, u) moves by exp(M s), M = [[A, B], [0, 0]], so the weight of a
    sample is the integral of exp(M's) W exp(M s) over the step (Franklin, Powell and Workman,
    Digital Control of Dynamic Systems, 1998, section 9.3.4). What the process noise adds within
    a step does not depend on the control and is left out.
    """
    n = len(system.A)
    m = system.B.shape[1]
    M = np.zeros((n + m, n + m))
    M[:n, :n], M[:n, n:] = system.A, system.B
    weight = integral(M.T, weights.weight, dt)
    return Cost(weight[:n, :n], weight[n:, n:], weight[:n, n:])


def is_short(dt: float, A: Array, poles: ComplexArray) -> bool:
    """Return whether nothing changes in a step, with these poles of the closed loop, or open."""
    fastest = max(np.abs(eigenvalues(A)).max(initial=0.0), np.abs(poles).max(initial=0.0))
    return bool(dt * fastest < _SHORT)


def sampled_lqr(system: LinearSystem, weights: Cost, dt: float) -> LqrDesign:
    """Return the gain for an input held over steps of ``dt`` that minimises the continuous cost.

    Where a step is too short for its changes to be computed with, it is that of continuous time.

    Raises
    ------
    DesignError
        If no gain stabilises the system with these weights.
    """
    step = system.sampled(dt)
    try:
        return dlqr(step.F, step.G, sampled_cost(system, weights, dt))
    except DesignError as error:
        design = lqr(system.A, system.B, weights)
        if not is_short(dt, system.A, design.poles):
            raise DesignError(f'{error}, in samples of {dt:g} s') from None
    return replace(design, poles=np.exp(design.poles * dt))
