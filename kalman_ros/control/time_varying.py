# SPDX-License-Identifier: Apache-2.0
"""The time-varying linear-quadratic regulator along a motion.

About x_k and u_k, small differences move by dx_{k+1} = F_k dx_k + G_k du_k. The gains with the
least cost come from the Riccati recursion, backwards from the end:

    K_k = (R + G'S G)^-1 (G'S F + N'),  S_k = Q + F'S (F - G K_k) - N K_k

with S = S_{k+1}, and S_N that of the regulator at the end (Anderson and Moore, Optimal Control:
Linear Quadratic Methods, 1990, section 2.3).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, DesignError, Dynamics
from kalman_ros.core.model import in_continuous_time, like, numerical_jacobian
from kalman_ros.linear.discretize import noise_integral
from kalman_ros.linear.matrices import symmetric

from .lqr import Cost, LqrDesign, dlqr
from .motion import Differences, Motion

#: The number of steps that are linearised at a time, which bounds the memory.
_CHUNK = 1000
#: Where a state cannot be regulated at rest, the cost of this many seconds counts there.
_HORIZON = 10.0
#: A mode that no input moves may not grow by more than rounding.
_GROWTH = 1e-9
#: Steps whose F and G differ by less than this, relative to the largest element, are the same.
_SAME = 1e-9


class Linearization(NamedTuple):
    """F (N, n, n) and G (N, n, m) of steps along a motion."""

    F: Array
    G: Array


def linearized_along(model: Dynamics, states: Array, inputs: Array, dt: float) -> Linearization:
    """Return the derivatives of the steps from ``states`` (N, n) with ``inputs`` (N, m)."""
    space = model.state

    def part(x: Array, u: Array) -> tuple[Array, Array]:
        F = numerical_jacobian(
            lambda points: model.step(points, like(u, points), dt), x, space.subtract, space
        )
        G = numerical_jacobian(
            lambda points: model.step(like(x, points), points, dt), u, space.subtract
        )
        return F, G

    chunks = [slice(k, k + _CHUNK) for k in range(0, len(states), _CHUNK)]
    F, G = zip(*(part(states[chunk], inputs[chunk]) for chunk in chunks))
    return Linearization(np.concatenate(F), np.concatenate(G))


def cost_along(model: Dynamics, states: Array, inputs: Array, weights: Cost, dt: float) -> Cost:
    """Return the cost of each step, stacked (N, ...), that equals the continuous cost over it.

    It is `sampled_cost` of the model linearised about each state; that of a model in discrete
    time is given for each of its periods.
    """
    N = len(states)
    n, m = weights.cross.shape
    if model.is_discrete:
        return Cost(*(np.broadcast_to(w, (N, *w.shape)) for w in (
            weights.state, weights.input, weights.cross)))  # fmt: skip
    continuous = in_continuous_time(model)
    M = np.zeros((N, n + m, n + m))
    for k in range(0, N, _CHUNK):
        chunk = slice(k, k + _CHUNK)
        M[chunk, :n, :n] = continuous.state_jacobian(states[chunk], inputs[chunk])
        M[chunk, :n, n:] = continuous.input_jacobian(states[chunk], inputs[chunk])
    weight = noise_integral(M.swapaxes(-1, -2), np.broadcast_to(weights.weight, M.shape), dt)
    return Cost(weight[:, :n, :n], weight[:, n:, n:], weight[:, :n, n:])


class Recursion(NamedTuple):
    """Gains K_k (N, m, n), weights R + G'S_{k+1} G (N, m, m), and S_0 (n, n)."""

    gains: Array
    weights: Array
    cost_to_go: Array


def backward_riccati(steps: Linearization, weights: Cost, S: Array) -> Recursion:
    """Return the time-varying regulator from the cost-to-go ``S`` at the end.

    Parameters
    ----------
    steps
        F and G of the N steps.
    weights
        Weights of the N steps, stacked.
    S
        S_N (n, n).
    """
    N, (n, m) = len(steps.G), steps.G.shape[1:]
    K, W = np.empty((N, m, n)), np.empty((N, m, m))
    rows = zip(steps.F[::-1], steps.G[::-1], weights.state[::-1], weights.input[::-1],
               weights.cross[::-1])  # fmt: skip
    for k, (F, G, Q, R, N) in enumerate(rows):
        GS = G.T.dot(S)
        W[-1 - k] = R + GS.dot(G)
        gain = np.linalg.solve(W[-1 - k], GS.dot(F) + N.T)
        S = symmetric(Q + F.T.dot(S).dot(F - G.dot(gain)) - N.dot(gain))
        K[-1 - k] = gain
    return Recursion(K, W, S)


def resting_regulator(F: Array, G: Array, weights: Cost, dt: float) -> LqrDesign:
    """Return the regulator at rest of a model that is steered while it moves.

    No input moves a robot on wheels sideways while it stands, so there is no gain that
    stabilises it. With the cost of the next seconds alone there is a best one, which leaves such
    states as they are.

    Raises
    ------
    DesignError
        If a state that no input moves grows.
    """
    count = max(round(_HORIZON / dt), 1)
    steps = Linearization(*(np.broadcast_to(matrix, (count, *matrix.shape)) for matrix in (F, G)))
    stacked = Cost(*(np.broadcast_to(w, (count, *w.shape)) for w in (
        weights.state, weights.input, weights.cross)))  # fmt: skip
    gains, _, S = backward_riccati(steps, stacked, weights.state)
    poles = np.linalg.eigvals(F - G.dot(gains[0]))
    largest = float(np.abs(poles).max(initial=0.0))
    if not largest <= 1.0 + _GROWTH:
        raise DesignError(
            f'no input holds the model at rest: a mode grows by {largest:.4g} a step'
        )
    return LqrDesign(gains[0], S, poles)


def with_gains(model: Dynamics, motion: Motion, weights: Cost) -> Motion:
    """Return a motion with the gains of the time-varying regulator.

    At the end they are those of the steady regulator of the last state.

    Parameters
    ----------
    model
        Dynamics of the motion.
    motion
        States and inputs.
    weights
        Continuous weights of x and u, or those of a period of a model in discrete time.
    """
    states, inputs, dt = motion.states, motion.inputs, motion.dt
    steps = linearized_along(model, states, inputs, dt)
    costs = cost_along(model, states, inputs, weights, dt)
    end = Cost(costs.state[-1], costs.input[-1], costs.cross[-1])
    rest = regulator_at_rest(steps.F[-1], steps.G[-1], end, dt)
    before = Cost(costs.state[:-1], costs.input[:-1], costs.cross[:-1])
    solution = backward_riccati(Linearization(steps.F[:-1], steps.G[:-1]), before, rest.cost_to_go)
    G = steps.G[-1]
    W = end.input + G.T @ rest.cost_to_go @ G
    return replace(
        motion,
        gains=np.concatenate((solution.gains, rest.gain[np.newaxis])),
        differences=Differences(*steps, np.concatenate((solution.weights, W[np.newaxis]))),
    )


def regulator_at_rest(F: Array, G: Array, weights: Cost, dt: float) -> LqrDesign:
    """Return the steady regulator, or `resting_regulator` where no gain stabilises."""
    try:
        return dlqr(F, G, weights)
    except DesignError:
        return resting_regulator(F, G, weights, dt)
