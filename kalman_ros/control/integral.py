# SPDX-License-Identifier: Apache-2.0
"""Integral action: a regulator without steady-state error under constant disturbances.

The integral q of the error z - r of the tracked states z = C x joins the state, and the
regulator is designed for both: u = -K x - K_q q (Franklin, Powell and Emami-Naeini, Feedback
Control of Dynamic Systems, 2015, section 7.10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, ArrayLike, DesignError, LinearSystem, semidefinite
from kalman_ros.linear.structure import ComplexArray

from .lqr import Cost, LqrDesign, dlqr, lqr, sampled_cost

#: A singular value this small, relative to the largest, counts as zero.
_RANK_TOLERANCE = 1e-10


@dataclass(frozen=True)
class IntegralDesign:
    """A feedback u = -K x - K_q q with the least cost.

    Parameters
    ----------
    gain
        K (m, n).
    integral_gain
        K_q (m, p). In continuous time dq/dt = z - r; sampled, q' = q + (z - r) dt.
    cost_to_go
        S (n + p, n + p) of the stacked vector (x, q).
    poles
        Eigenvalues of the closed loop (n + p,).
    """

    gain: Array
    integral_gain: Array
    cost_to_go: Array
    poles: ComplexArray


def lqi(
    system: LinearSystem, tracked: Sequence[str], weights: Cost, integral_cost: ArrayLike
) -> IntegralDesign:
    """Return the regulator with integral action on the ``tracked`` states, in continuous time.

    Parameters
    ----------
    system
        The plant.
    tracked
        Names of the p states that must reach their reference.
    weights
        Of x and u, as for `lqr`.
    integral_cost
        The weight of q'q: p numbers or a matrix (p, p), positive definite.

    Raises
    ------
    ValueError
        If a name is unknown or a size is wrong.
    DesignError
        If no steady input holds the tracked states (a zero at s = 0), or no gain stabilises.
    """
    A, B = system.A, system.B
    C, cost = _tracked(system, tracked), _weights(weights, integral_cost, len(tracked))
    _check_zero(A, B, C, tracked, 's = 0')
    n, p = len(A), len(C)
    augmented = np.block([[A, np.zeros((n, p))], [C, np.zeros((p, p))]])
    inputs = np.vstack((B, np.zeros((p, B.shape[1]))))
    return _split(lqr(augmented, inputs, cost), n)


def sampled_lqi(
    system: LinearSystem,
    tracked: Sequence[str],
    weights: Cost,
    integral_cost: ArrayLike,
    dt: float,
) -> IntegralDesign:
    """Return the regulator with integral action for an input held over steps of ``dt``.

    The plant and its cost are sampled exactly. q is the sum of the errors times dt, which is
    what a controller can compute without a model: the exact integral between samples needs one,
    and with a wrong one its steady state is not that of z = r.

    Raises
    ------
    ValueError, DesignError
        As `lqi`; the zero is at z = 1.
    """
    step = system.sampled(dt)
    F, G = step.F, step.G
    C = _tracked(system, tracked)
    n, p = len(F), len(C)
    _check_zero(F - np.eye(n), G, C, tracked, 'z = 1')
    cost = _weights(sampled_cost(system, weights, dt), np.asarray(integral_cost) * dt, p)
    augmented = np.block([[F, np.zeros((n, p))], [C * dt, np.eye(p)]])
    inputs = np.vstack((G, np.zeros((p, G.shape[1]))))
    return _split(dlqr(augmented, inputs, cost), n)


def _tracked(system: LinearSystem, tracked: Sequence[str]) -> Array:
    """Return the rows C (p, n) of z = C x."""
    if not tracked or len(set(tracked)) != len(tracked):
        raise ValueError(f'tracked: expected one or more unique names, got {tuple(tracked)}')
    return np.eye(system.state.size)[system.state.indices(tracked, 'tracked')]


def _weights(weights: Cost, integral_cost: ArrayLike, p: int) -> Cost:
    """Return the cost of (x, q) and u."""
    Q, N = weights.state, weights.cross
    n, m = N.shape
    stacked = np.zeros((n + p, n + p))
    stacked[:n, :n] = Q
    stacked[n:, n:] = semidefinite('integral_cost', integral_cost, p, definite=True)
    return Cost(stacked, weights.input, np.vstack((N, np.zeros((p, m)))))


def _check_zero(A: Array, B: Array, C: Array, tracked: Sequence[str], where: str) -> None:
    """Raise if [A B; C 0] loses rows: some z cannot be held, and its integral diverges."""
    p, m = len(C), B.shape[1]
    system = np.block([[A, B], [C, np.zeros((p, m))]])
    left, sizes, _ = np.linalg.svd(system)
    rank = int(np.sum(sizes > _RANK_TOLERANCE * sizes[0]))
    lost = np.abs(left[-p:, rank:]).max(axis=1, initial=0.0) > 1e-6
    if lost.any():
        names = ', '.join(name for name, there in zip(tracked, lost) if there)
        why = f', and {m} inputs hold no more than {m} states' if p > m else ''
        raise DesignError(
            f'tracked: no steady input holds {names} at a reference: the plant has a zero at '
            f'{where} from its input to there{why}'
        )


def _split(design: LqrDesign, n: int) -> IntegralDesign:
    K = design.gain
    return IntegralDesign(K[:, :n], K[:, n:], design.cost_to_go, design.poles)
