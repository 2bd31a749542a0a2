# SPDX-License-Identifier: Apache-2.0
"""The scatter of the average NEES of one run of a consistent filter.

Errors are correlated from step to step: a filter with a long memory has few independent errors
in a run. The memory of the best one follows from its covariances P, the posterior Cramer-Rao
bound; those that the filter published may be wrong, and are what is tested:

    e' = A e + ...,  A = P' (F P F' + Q)^-1 F,

for P' = (I - K H) (F P F' + Q) where there was a reading, and A = F elsewhere. Normalised by the
roots of P the errors are N(0, I), the transition is M = L'^-1 A L with P = L L', and of two
quadratic forms z_j' z_j and z_k' z_k the covariance is 2 ||M_{j-1} ... M_k||^2 (Frobenius).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, in_continuous_time
from kalman_ros.estimators.consistency import nees
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .bounds import posterior_cramer_rao

#: The start is omitted until this share of its errors is left, but never more than half of a run.
_FORGOTTEN = 0.1


class AverageNees(NamedTuple):
    """The NEES of a run divided by n, averaged over the steps from ``first`` on.

    For a consistent filter ``mean`` has the expectation 1 and the variance ``variance``.
    """

    first: int
    mean: float
    variance: float


def average_nees(scenario: Scenario, run: Trajectory) -> AverageNees:
    """Return the average NEES of a run after its start; linear to first order.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is singular, published or theoretical.
    """
    space = scenario.model.state
    steps, n = run.truth.shape
    moves = _normalised_moves(scenario, run)
    first = _forgotten(moves, steps // 2)
    # for each step, the sum over itself and all later ones of the squared norms
    total, rest = 0.0, np.zeros((n, n))
    for k in range(steps - 1, first - 1, -1):
        rest = np.eye(n) if k == steps - 1 else np.eye(n) + moves[k].T @ rest @ moves[k]
        total += 2.0 * float(np.trace(rest)) - n
    count = steps - first
    error = space.subtract(run.truth[first:], run.estimate[first:])
    mean = float(nees(error, run.covariance[first:]).mean()) / n
    # an average never scatters more than one value
    return AverageNees(first, mean, min(2.0 * total / (n * count) ** 2, 2.0 / n))


def _normalised_moves(scenario: Scenario, run: Trajectory) -> Array:
    """Return M (N - 1, n, n), with F and Q of each step to second order in its length."""
    model, x, u = in_continuous_time(scenario.model), run.truth[:-1], run.input[:-1]
    # in whole steps, some of which may be missing in real time
    dt = scenario.plan.dt * np.rint(np.diff(run.time) * scenario.rate)[:, None, None]
    known = posterior_cramer_rao(scenario, run.truth, run.input, run.readings, run.time)
    roots, P = np.linalg.cholesky(known), known[:-1]
    A = np.array([model.state_jacobian(*point) for point in zip(x, u)])
    W = np.array([model.noise_density(each) for each in x])
    F = np.eye(model.state.size) + dt * A + 0.5 * dt**2 * A @ A
    Q = dt * W + 0.5 * dt**2 * (A @ W + W @ A.swapaxes(-1, -2))
    move = known[1:] @ np.linalg.solve(F @ P @ F.swapaxes(-1, -2) + Q, F)
    return np.linalg.solve(roots[1:], move @ roots[:-1])


def _forgotten(moves: Array, most: int) -> int:
    """Return the first step at which little of the initial error is left."""
    left = np.eye(moves.shape[-1])
    for k in range(min(most, len(moves))):
        left = moves[k] @ left
        if np.linalg.norm(left) <= _FORGOTTEN:
            return k + 1
    return most
