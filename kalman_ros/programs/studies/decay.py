# SPDX-License-Identifier: Apache-2.0
"""What a loop costs on its way from a start to rest, and how far a little noise scatters that."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from kalman_ros.control.lqr import Cost
from kalman_ros.core import Array, Transition

from .stationary import SIGMAS

#: What rounding adds to a sum of thousands of products, relative to it.
ROUNDING = 1e-9


def price(
    step: Transition, gain: Array, cost: Cost, start: Array, steps: int
) -> tuple[float, float]:
    """Return the sum over ``steps`` samples of the cost of u = -K x, and its tolerance.

    From x on to the end of time it is x'X x, with X from the Lyapunov equation; the part after
    the last sample is taken off. Process noise w adds 2 x'X w at each x, to first order.
    """
    M = step.F - step.G @ gain
    stacked = np.vstack((np.eye(len(M)), -gain))
    X = solve_discrete_lyapunov(M.T, stacked.T @ cost.weight @ stacked)
    last = np.linalg.matrix_power(M, steps) @ start
    expected = float(start @ X @ start - last @ X @ last)
    scatter = solve_discrete_lyapunov(M.T, 4.0 * X @ step.Q @ X)
    deviation = float(np.sqrt(start @ scatter @ start))
    return expected, SIGMAS * deviation + ROUNDING * expected
