# SPDX-License-Identifier: Apache-2.0
"""The steady-state Kalman filter, in continuous and in sampled time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kalman_ros.core import Array, DesignError, Discretization, matrix, semidefinite
from kalman_ros.linear import riccati
from kalman_ros.linear.periodic import Readings, updated
from kalman_ros.linear.structure import ComplexArray

from .lqr import is_short


@dataclass(frozen=True)
class LqeDesign:
    """An observer with the least error covariance.

    Parameters
    ----------
    gain
        L (n, k). In sampled time the gain of the current estimate: x_hat += L (y - C x_hat).
    predictor_gain
        In sampled time the gain L_p (n, k) of the estimate one step ahead, from one to the
        next: x_hat' = F x_hat + G u + L_p (y - C x_hat); else the same as ``gain``.
    covariance
        The error covariance (n, n); in sampled time after the reading.
    prior
        In sampled time the error covariance before the reading; else the same as ``covariance``.
    poles
        Eigenvalues of the error dynamics (n,): of A - L C, or of F - L_p C when sampled.
    """

    gain: Array
    predictor_gain: Array
    covariance: Array
    prior: Array
    poles: ComplexArray


def lqe(A: Array, C: Array, W: Array, V: Array, cross: Array | None = None) -> LqeDesign:
    """Return the Kalman-Bucy gain L = (P C' + N) V^-1 of dx/dt = A x + w, y = C x + v.

    Parameters
    ----------
    A, C
        Matrices (n, n) and (k, n).
    W, V
        Spectral densities of w (n, n) and of v (k, k).
    cross
        Their cross density N = E[w v'] (n, k); None means independent.

    Raises
    ------
    ValueError
        If W, V and N together are no covariance.
    DesignError
        If the readings cannot keep the error of some mode bounded, a mode that stays has no
        process noise, or the noise of the readings is singular or of a size that cannot be
        weighed against the process noise.
    """
    N = _cross(W, V, cross)
    solution = riccati.continuous(A.T, C.T, W, V, N, riccati.ESTIMATION)
    L, P = solution.K.T, solution.S
    return LqeDesign(L, L, P, P, solution.poles)


def dlqe(F: Array, C: Array, Q: Array, R: Array, cross: Array | None = None) -> LqeDesign:
    """Return the steady-state gains of x' = F x + w, y = C x + v; w ~ N(0, Q), v ~ N(0, R).

    With S = C P C' + R they are L = P C' S^-1 and L_p = (F P C' + N) S^-1 (Anderson and Moore,
    Optimal Filtering, 1979, section 5.4). L_p = F L where the noises are independent; otherwise
    a reading also contains part of the noise that moves the state next.

    Parameters
    ----------
    F, C
        Matrices (n, n) and (k, n).
    Q, R
        Covariances of w (n, n) and of v (k, k).
    cross
        The covariance N = E[w v'] (n, k) of a reading's noise with that of the step after it;
        None means independent.

    Raises
    ------
    ValueError
        If Q, R and N together are no covariance.
    DesignError
        If the readings cannot keep the error of some mode bounded, a mode that stays has no
        process noise, or the noise of the readings is singular or of a size that cannot be
        weighed against the process noise.
    """
    N = _cross(Q, R, cross)
    solution = riccati.discrete(F.T, C.T, Q, R, N, riccati.ESTIMATION)
    L, after = updated(solution.S, Readings(C, R))
    return LqeDesign(L, solution.K.T, after, solution.S, solution.poles)


def sampled_lqe(A: Array, C: Array, W: Array, V: Array, dt: float) -> LqeDesign:
    """Return the steady-state gains of dx/dt = A x + w with a reading y = C x + v every ``dt``.

    W is the spectral density of w (n, n) and V the covariance of v (k, k). Where a step is too
    short for its changes to be computed with, they are those of continuous time.

    Raises
    ------
    DesignError
        As `dlqe`.
    """
    F, _, Q = Discretization(A, np.zeros((len(A), 0)), W)(dt)
    try:
        return dlqe(F, C, Q, V)
    except DesignError as error:
        design = lqe(A, C, W, V * dt)
        if not is_short(dt, A, design.poles):
            raise DesignError(f'{error}, in samples of {dt:g} s') from None
    gain = design.gain * dt
    return replace(design, gain=gain, predictor_gain=gain, poles=np.exp(design.poles * dt))


def _cross(W: Array, V: Array, cross: Array | None) -> Array:
    """Return the checked cross covariance (n, k), or zeros."""
    n, k = len(W), len(V)
    if cross is None:
        return np.zeros((n, k))
    N = matrix('cross', cross, (n, k))
    semidefinite('cross with the noises', np.block([[W, N], [N.T, V]]), n + k)
    return N
