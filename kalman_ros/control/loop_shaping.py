# SPDX-License-Identifier: Apache-2.0
"""H-infinity loop shaping: the most robust regulator and estimator for a given shape of the loop.

Weights shape the plant first: its inputs in units of R^-1/2, its readings in units of V^-1/2. The
controller then stabilises all plants N / M whose normalised coprime factors differ from those of
the shaped plant by less than 1 / gamma, and no controller does so for 1 / gamma_min (K. Glover and
D. McFarlane, IEEE Trans. Automatic Control 34(8), 1989; S. Skogestad and I. Postlethwaite,
Multivariable Feedback Control, 2005, section 9.4). Two Riccati equations solve it:

    A'X + X A - X B R^-1 B'X + C'V^-1 C = 0,  A Z + Z A' - Z C'V^-1 C Z + B R^-1 B' = 0
    gamma_min^2 = 1 + rho(Z X)
    u = -K x_hat,  K = R^-1 B'X,  L = P C'V^-1,  P = gamma^2 ((gamma^2 - 1) 1 - Z X)^-1 Z

It is an LQG controller for other noise: P is the error covariance of the Kalman filter with

    W = P ((gamma^2 - 1) Z^-1 B R^-1 B'Z^-1 + X B R^-1 B'X) P / gamma^2

so the regulator is the one of state cost C'V^-1 C, and any Kalman filter with W is its estimator.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, matrix, semidefinite

from .lqe import LqeDesign, lqe
from .lqr import LqrDesign, cost, lqr
from .state_space import StateSpace

#: By how much gamma exceeds its least value, at which the controller degenerates.
BEYOND = 1.1


@dataclass(frozen=True)
class LoopShaping:
    """A controller that is most robust for a shape of the loop.

    Parameters
    ----------
    regulator
        K and its cost, of the state cost ``state_cost``.
    estimator
        L and its covariance P, of the process noise ``noise``.
    state_cost
        C'V^-1 C (n, n).
    noise
        W (n, n), as a spectral density.
    least, gamma
        gamma_min, and the one of this controller.
    """

    regulator: LqrDesign
    estimator: LqeDesign
    state_cost: Array
    noise: Array
    least: float
    gamma: float

    @property
    def stability_margin(self) -> float:
        """The size of the changes of coprime factors that keep the loop stable, 1 / gamma."""
        return 1.0 / self.gamma


def loop_shaping(plant: StateSpace, R: Array, V: Array, beyond: float = BEYOND) -> LoopShaping:
    """Return the H-infinity controller for a plant that R and V shape.

    Parameters
    ----------
    plant
        dx/dt = A x + B u, y = C x.
    R
        Input cost (m, m): a smaller one gives a faster loop.
    V
        Noise of the readings (k, k), as a spectral density.
    beyond
        gamma divided by gamma_min, above 1.

    Raises
    ------
    ValueError
        If a size is wrong, the plant is sampled or has a direct path, or ``beyond`` is at most 1.
    DesignError
        If no input stabilises a mode, or no reading observes it.
    """
    if plant.sampled or np.any(plant.D):
        raise ValueError('plant: expected one in continuous time with D = 0')
    if not 1.0 < beyond < np.inf:
        raise ValueError(f'beyond: expected a factor above 1, got {beyond:g}')
    A, B, C = plant.A, plant.B, matrix('C', plant.C, plant.C.shape)
    R = semidefinite('R', R, B.shape[1], definite=True)
    V = semidefinite('V', V, len(C), definite=True)
    state_cost = C.T @ np.linalg.solve(V, C)
    control_noise = B @ np.linalg.solve(R, B.T)
    regulator = lqr(A, B, cost(state_cost, R, B.shape))
    X, Z = regulator.cost_to_go, lqe(A, C, control_noise, V).covariance
    least = float(np.sqrt(1.0 + np.linalg.eigvals(Z @ X).real.max()))
    gamma = beyond * least
    # with Z = T T', so that a Z without full rank needs no inverse
    values, vectors = np.linalg.eigh(Z)
    T = vectors * np.sqrt(np.maximum(values, 0.0))
    inner = (gamma**2 - 1.0) * np.eye(len(A)) - T.T @ X @ T
    P = gamma**2 * T @ np.linalg.solve(inner, T.T)
    # P Z^-1 = gamma^2 ((gamma^2 - 1) 1 - Z X)^-1
    by_inverse = gamma**2 * np.linalg.inv((gamma**2 - 1.0) * np.eye(len(A)) - Z @ X)
    noise = (gamma**2 - 1.0) * by_inverse @ control_noise @ by_inverse.T
    noise = (noise + P @ X @ control_noise @ X @ P) / gamma**2
    noise = 0.5 * (noise + noise.T)
    return LoopShaping(regulator, lqe(A, C, noise, V), state_cost, noise, least, gamma)
