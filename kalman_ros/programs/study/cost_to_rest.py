# SPDX-License-Identifier: Apache-2.0
"""The cost of a loop from a start to rest, and its scatter by small noise."""

from __future__ import annotations

import numpy as np

from kalman_ros.control.lqr import Cost
from kalman_ros.core import Array, Transition
from kalman_ros.linear.lyapunov import stationary_covariance

from .stationary import SIGMAS

#: Relative rounding error of a sum of thousands of products.
ROUNDING = 1e-9


def price(
    step: Transition, gain: Array, cost: Cost, start: Array, steps: int
) -> tuple[float, float]:
    """Return the sum over ``steps`` samples of the cost of u = -K x, and its tolerance.

    The infinite sum from x is x'X x, with X from the Lyapunov equation; the part after
    the last sample is subtracted. Process noise w adds 2 x'X w at each x, to first order.
    """
    M = step.F - step.G @ gain
    stacked = np.vstack((np.eye(len(M)), -gain))
    X = stationary_covariance(M.T, stacked.T @ cost.weight @ stacked, sampled=True)
    last = np.linalg.matrix_power(M, steps) @ start
    expected = float(start @ X @ start - last @ X @ last)
    scatter = stationary_covariance(M.T, 4.0 * X @ step.Q @ X, sampled=True)
    deviation = float(np.sqrt(start @ scatter @ start))
    return expected, SIGMAS * deviation + ROUNDING * expected
