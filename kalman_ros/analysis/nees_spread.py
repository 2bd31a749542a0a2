# SPDX-License-Identifier: Apache-2.0
"""The scatter of the average NEES of one run of a consistent filter.

Errors are correlated from step to step: a filter with a long memory has few independent errors
in a run. The memory of the optimal filter follows from its covariances P, the posterior Cramer-Rao
bound. The covariances that the filter published are not used, since they are under test:

    e' = A e + ...,  A = P' (F P F' + Q)^-1 F,

with P' = (I - K H) (F P F' + Q) at a step with a reading, and A = F at any other step. Normalised
by the square roots of P, the errors are N(0, I) and the transition is M = L'^-1 A L with P = L L'.
The covariance of two quadratic forms z_j' z_j and z_k' z_k is 2 ||M_{j-1} ... M_k||^2 (Frobenius
norm).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, in_continuous_time
from kalman_ros.estimators.consistency import nees
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .bounds import posterior_cramer_rao

#: The start of a run is omitted until this share of the initial error is left, up to half a run.
_FORGOTTEN = 0.1


class AverageNees(NamedTuple):
    """The NEES of a run, divided by n and averaged over the steps from ``first`` on.

    For a consistent filter, ``mean`` has the expectation 1 and the variance ``variance``.
    """

    first: int
    mean: float
    variance: float


def average_nees(scenario: Scenario, run: Trajectory) -> AverageNees:
    """Return the average NEES of a run after its start, with its variance to first order.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a published or a theoretical covariance is singular.
    """
    space = scenario.model.state
    steps, n = run.truth.shape
    transitions = _normalised_transitions(scenario, run)
    first = _forgetting_step(transitions, steps // 2)
    # sum the squared norms over all pairs of a step with itself and with later steps
    total, tail = 0.0, np.zeros((n, n))
    for k in range(steps - 1, first - 1, -1):
        tail = (
            np.eye(n) if k == steps - 1 else np.eye(n) + transitions[k].T @ tail @ transitions[k]
        )
        total += 2.0 * float(np.trace(tail)) - n
    count = steps - first
    error = space.subtract(run.truth[first:], run.estimate[first:])
    mean = float(nees(error, run.covariance[first:]).mean()) / n
    # an average never scatters more than a single value
    return AverageNees(first, mean, min(2.0 * total / (n * count) ** 2, 2.0 / n))


def _normalised_transitions(scenario: Scenario, run: Trajectory) -> Array:
    """Return M (N - 1, n, n), with F and Q of each step to second order in the step length."""
    model, x, u = in_continuous_time(scenario.model), run.truth[:-1], run.input[:-1]
    # a multiple of the step, since steps may be missing in real time
    dt = scenario.plan.dt * np.rint(np.diff(run.time) * scenario.rate)[:, None, None]
    bound = posterior_cramer_rao(scenario, run.truth, run.input, run.readings, run.time)
    roots, P = np.linalg.cholesky(bound), bound[:-1]
    A = np.array([model.state_jacobian(*point) for point in zip(x, u)])
    W = np.array([model.noise_density(state) for state in x])
    F = np.eye(model.state.size) + dt * A + 0.5 * dt**2 * A @ A
    Q = dt * W + 0.5 * dt**2 * (A @ W + W @ A.swapaxes(-1, -2))
    transition = bound[1:] @ np.linalg.solve(F @ P @ F.swapaxes(-1, -2) + Q, F)
    return np.linalg.solve(roots[1:], transition @ roots[:-1])


def _forgetting_step(transitions: Array, most: int) -> int:
    """Return the first step at which the initial error is forgotten, at most ``most``."""
    remaining = np.eye(transitions.shape[-1])
    for k in range(min(most, len(transitions))):
        remaining = transitions[k] @ remaining
        if np.linalg.norm(remaining) <= _FORGOTTEN:
            return k + 1
    return most
