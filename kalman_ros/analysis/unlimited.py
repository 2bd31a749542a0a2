# SPDX-License-Identifier: Apache-2.0
"""The starts from which no limit of inputs or states acts on a loop."""

from __future__ import annotations

import numpy as np

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.limiter import Limits
from kalman_ros.core import Array
from kalman_ros.scenario import Scenario

#: The loop is simulated until this part of a start is left, or for this many steps.
_LEFT, _MOST_STEPS = 1e-6, 20_000


def unlimited_starts(scenario: Scenario, law: Feedback, limits: Limits) -> Array:
    """Return how far each state may begin below and above the equilibrium (n, 2).

    The loop is simulated from each of these 2 n starts, the other states at rest and the state
    known; it is linear, and limits are convex, so no limit acts from any start in the hull of
    these points, either. Infinite where no start is too far.
    """
    dt, point = 1.0 / scenario.rate, scenario.model.equilibrium
    step, regulator = scenario.model.transition(*point, dt), law.system(dt)
    n, q = len(step.F), len(regulator.A)
    u = -np.hstack((regulator.D, regulator.C))
    A = np.vstack((
        np.hstack((step.F, np.zeros((n, q)))) + step.G @ u,
        np.hstack((regulator.B, regulator.A)),
    ))  # fmt: skip
    # everything that has limits, as a function of state and integrals, about the equilibrium
    signals = np.vstack((u, np.eye(n, n + q)))
    free = np.full(n, np.inf)
    states = (-free, free) if law.prediction is None else (law.prediction.low, law.prediction.high)
    low = np.concatenate((limits.lower - point.input, states[0] - point.state))
    high = np.concatenate((limits.upper - point.input, states[1] - point.state))
    state, before = np.eye(n + q, n), np.zeros((len(u), n))
    most, least = np.zeros((len(low), n)), np.zeros((len(low), n))
    steepest = np.zeros((len(u), n))
    for _ in range(_MOST_STEPS):
        values = signals @ state
        most, least = np.maximum(most, values), np.minimum(least, values)
        steepest = np.maximum(steepest, np.abs(values[: len(u)] - before))
        state, before = A @ state, values[: len(u)]
        if np.abs(state).max() < _LEFT:
            break
    rate = _room(limits.rate * dt, steepest)
    above = np.minimum(_room(high, most), _room(-low, -least))
    below = np.minimum(_room(high, -least), _room(-low, most))
    return np.stack((np.minimum(below, rate), np.minimum(above, rate)), axis=1)


def _room(bounds: Array, values: Array) -> Array:
    """Return the largest factors (n,) of values (k, n) >= 0 that keep all bounds (k,)."""
    with np.errstate(divide='ignore', invalid='ignore'):
        factors = np.maximum(bounds, 0.0)[:, np.newaxis] / values
    factors[values <= 0.0] = np.inf
    return np.asarray(factors.min(axis=0, initial=np.inf))
