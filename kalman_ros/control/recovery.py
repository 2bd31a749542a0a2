# SPDX-License-Identifier: Apache-2.0
"""Loop transfer recovery: an estimator that restores the margins of the regulator.

With fictitious noise at the plant's input, W + q^2 B V B', the estimator grows fast in
the directions in which the input acts, and the LQG loop H P tends to the regulator's
K (s I - A)^-1 B as q grows: at every frequency if no zero of the plant is in the right half
plane, else as far as the zeros allow. It costs noise at the input (Doyle and Stein, IEEE Trans.
Automatic Control 24(4), 1979; Anderson and Moore, Optimal Control, 1990, section 8.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, matrix, semidefinite, vector

from .compensator import compensator, current_compensator
from .lqe import LqeDesign, dlqe, lqe
from .state_space import StateSpace, static


@dataclass(frozen=True)
class Recovery:
    """One design of the sequence.

    Parameters
    ----------
    strength
        q of the noise at the input.
    estimator
        The estimator for that noise.
    controller
        The `compensator` H with it; sampled, the one that uses the current reading.
    loop
        L = H P, broken at the plant's input (m, m).
    target
        The regulator's own loop, which L tends to.
    """

    strength: float
    estimator: LqeDesign
    controller: StateSpace
    loop: StateSpace
    target: StateSpace

    def gap(self, frequencies: Array) -> Array:
        """Return |L - target| / |target| (k,), by largest singular values, at rad/s (k,)."""
        L, target = self.loop.response(frequencies), self.target.response(frequencies)
        return np.asarray(
            np.linalg.norm(L - target, 2, axis=(1, 2)) / np.linalg.norm(target, 2, axis=(1, 2))
        )


def recover(
    plant: StateSpace,
    regulator_gain: Array,
    noises: tuple[Array, Array],
    strengths: Sequence[float],
    input_noise: Array | None = None,
) -> tuple[Recovery, ...]:
    """Return a design for each of ``strengths``; 0 is the LQG design without recovery.

    Parameters
    ----------
    plant
        dx/dt = A x + B u, y = C x, or the same in samples.
    regulator_gain
        K (m, n), of a loop with the wanted margins.
    noises
        W (n, n) and that of the readings (k, k): densities, or covariances when sampled.
    strengths
        The q, ascending.
    input_noise
        V (m, m) of the fictitious noise at the input; None means the identity.

    Raises
    ------
    ValueError
        If a size is wrong, a strength negative, or the plant has a direct path.
    DesignError
        If the readings cannot keep the error of some mode bounded.
    """
    A, B, C = plant.A, plant.B, plant.C
    m = B.shape[1]
    K = matrix('regulator_gain', regulator_gain, (B.shape[1], B.shape[0]))
    W, R = (
        semidefinite('W', noises[0], len(A)),
        semidefinite('V', noises[1], len(C), definite=True),
    )
    V = np.eye(m) if input_noise is None else semidefinite('input_noise', input_noise, m)
    if not np.all(vector('strengths', strengths) >= 0.0) or np.any(plant.D):
        raise ValueError(f'strengths: expected q >= 0 and a plant with D = 0, got {strengths}')
    target = StateSpace(A, B, K, np.zeros((m, m)), plant.dt)
    designs = []
    for q in strengths:
        noise = W + q**2 * B @ V @ B.T
        if plant.sampled:
            estimator = dlqe(A, C, noise, R)
            H = current_compensator(plant, static(K, plant.dt), estimator)
        else:
            estimator = lqe(A, C, noise, R)
            H = compensator(plant, K, estimator.gain)
        designs.append(Recovery(float(q), estimator, H, H @ plant, target))
    return tuple(designs)
