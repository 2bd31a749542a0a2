# SPDX-License-Identifier: Apache-2.0
"""Observer and state feedback as one system, from the readings y to the input u = -H y.

Around the plant it has the poles of the regulator and those of the estimator (Anderson and
Moore, Optimal Control, 1990, section 8.2). References and set points are omitted: they do not
change the loop.
"""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, matrix

from .lqe import LqeDesign
from .state_space import StateSpace


def compensator(plant: StateSpace, regulator_gain: Array, observer_gain: Array) -> StateSpace:
    """Return H of dx_hat/dt = A x_hat + B u + L (y - C x_hat), u = -K x_hat.

    Sampled, with the next x_hat on the left, L is the gain of a predictor: the input answers
    the readings up to the step before, so a whole sample is left to compute it.

    Parameters
    ----------
    plant
        From the input (m) to the readings (k); a direct path D is allowed.
    regulator_gain, observer_gain
        K (m, n) and L (n, k), by any design.

    Raises
    ------
    ValueError
        If a size is wrong.
    """
    A, B, C, D = plant.A, plant.B, plant.C, plant.D
    K = matrix('regulator_gain', regulator_gain, (B.shape[1], B.shape[0]))
    L = matrix('observer_gain', observer_gain, (C.shape[1], C.shape[0]))
    inner = A - B @ K - L @ (C - D @ K)
    return StateSpace(inner, L, K, np.zeros((len(K), len(C))), plant.dt)


def current_compensator(
    plant: StateSpace, regulator: StateSpace, estimator: LqeDesign
) -> StateSpace:
    """Return H of the sampled loop in which the input answers the reading just made.

    The regulator q' = A q + B x, u = -(C q + D x) uses x_hat + L (y - C x_hat) as x, with
    x_hat the prediction, updated by x_hat' = F x_hat + G u + L_p (y - C x_hat).

    Parameters
    ----------
    plant
        A sampled one, without a direct path from the input to the readings.
    regulator
        From x (n) to -u (m): a gain as a `static` system, or one with states.
    estimator
        Its gains L and L_p.

    Raises
    ------
    ValueError
        If a size is wrong, or the plant is continuous or has a direct path.
    """
    F, G, C = plant.A, plant.B, plant.C
    if not plant.sampled or np.any(plant.D):
        raise ValueError('plant: expected a sampled one with D = 0: y is read before u is known')
    K_q = regulator.C
    K = matrix('regulator.D', regulator.D, (G.shape[1], G.shape[0]))
    L = matrix('estimator.gain', estimator.gain, (C.shape[1], C.shape[0]))
    L_p = matrix('estimator.predictor_gain', estimator.predictor_gain, (C.shape[1], C.shape[0]))
    I_LC = np.eye(len(F)) - L @ C
    A = np.block([
        [F - L_p @ C - G @ K @ I_LC, -G @ K_q],
        [regulator.B @ I_LC, regulator.A],
    ])  # fmt: skip
    B = np.vstack((L_p - G @ K @ L, regulator.B @ L))
    return StateSpace(A, B, np.hstack((K @ I_LC, K_q)), K @ L, plant.dt)
