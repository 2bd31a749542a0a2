# SPDX-License-Identifier: Apache-2.0
"""The steady-state cost of a loop with any linear controller, optimal or not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, DesignError, semidefinite
from kalman_ros.linear.lyapunov import stationary_covariance
from kalman_ros.linear.structure import describe, eigenvalues, is_stable, unstable

from .lqr import Cost
from .state_space import StateSpace


@dataclass(frozen=True)
class NoisyLoop:
    """A closed loop of plant and controller, driven by white noise.

    z' = A z + b and e = C z + d, or dz/dt in place of the next z, with a cost |e|^2.

    Parameters
    ----------
    A, C
        Matrices (n, n) and (p, n).
    noise
        Covariance, or spectral density, of b (n, n).
    direct
        Mean of |d|^2.
    sampled
        Whether time is discrete.
    """

    A: Array
    C: Array
    noise: Array
    direct: float
    sampled: bool

    @property
    def cost(self) -> float:
        """The mean of the cost in steady state.

        The covariance of z solves the Lyapunov equation (Anderson and Moore, Optimal Control,
        1990, section 8.2).

        Raises
        ------
        DesignError
            If the loop is not stable.
        """
        if not is_stable(self.A, sampled=self.sampled):
            growing = unstable(eigenvalues(self.A), sampled=self.sampled)
            raise DesignError(f'the loop is not stable: it has poles at {describe(growing)}')
        covariance = stationary_covariance(self.A, self.noise, sampled=self.sampled)
        return float(np.einsum('ij,jk,ik', self.C, covariance, self.C)) + self.direct


def noisy_loop(
    plant: StateSpace, controller: StateSpace, W: Array, V: Array, weights: Cost
) -> NoisyLoop:
    """Return the loop of a plant and any linear controller, with the cost of state and input.

    Parameters
    ----------
    plant
        dx/dt = A x + B u + w, y = C x + v, or the same in samples.
    controller
        H of u = -H y, as `compensator` returns it.
    W, V
        Of the independent noises w (n, n) and v (k, k): spectral densities, or covariances when
        sampled.
    weights
        The cost; in samples that of one sample, as `sampled_cost` returns it.

    Raises
    ------
    ValueError
        If a size is wrong, or the plant has a direct path.
    DesignError
        If the cost is infinite, as it is where a continuous controller passes white noise
        straight on to the input.
    """
    A, B, C = plant.A, plant.B, plant.C
    n, k = len(A), len(C)
    if np.any(plant.D) or controller.dt != plant.dt or controller.D.shape != (B.shape[1], k):
        raise ValueError(
            f'controller: expected {k} inputs, {B.shape[1]} outputs and dt {plant.dt} for a plant '
            f'with D = 0, got shape {controller.D.shape} and dt {controller.dt}'
        )
    noise = np.zeros((n + k, n + k))
    noise[:n, :n], noise[n:, n:] = semidefinite('W', W, n), semidefinite('V', V, k)
    H = controller
    if not plant.sampled and np.any(H.D @ noise[n:, n:]):
        raise DesignError('controller: it passes white noise straight on to the input')
    # z = (x, controller's state); (x, u) = outputs z + direct v
    loop = np.block([[A - B @ H.D @ C, -B @ H.C], [H.B @ C, H.A]])
    driven = np.block([[np.eye(n), -B @ H.D], [np.zeros((len(H.A), n)), H.B]])
    outputs = np.block([[np.eye(n), np.zeros((n, len(H.A)))], [-H.D @ C, -H.C]])
    root = _root(weights.weight)
    direct = root @ np.vstack((np.zeros((n, k)), -H.D))
    return NoisyLoop(
        loop, root @ outputs, driven @ noise @ driven.T,
        float(np.einsum('ij,jk,ik', direct, noise[n:, n:], direct)), plant.sampled,
    )  # fmt: skip


def stationary_cost(
    plant: StateSpace, controller: StateSpace, W: Array, V: Array, weights: Cost
) -> float:
    """Return the mean of x'Q x + 2 x'N u + u'R u: per second, or per sample when sampled.

    The arguments are those of `noisy_loop`.

    Raises
    ------
    ValueError
        If a size is wrong, or the plant has a direct path.
    DesignError
        If the loop is not stable, or the cost is infinite, as it is where a continuous
        controller passes white noise straight on to the input.
    """
    return noisy_loop(plant, controller, W, V, weights).cost


def _root(weight: Array) -> Array:
    """Return X with X'X = weight, which is positive semi-definite."""
    values, vectors = np.linalg.eigh(weight)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, np.newaxis] * vectors.T)
