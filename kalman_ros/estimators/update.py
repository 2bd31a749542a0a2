# SPDX-License-Identifier: Apache-2.0
"""The measurement update that the linear and linearised filters share."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

from kalman_ros.core import Array, Gaussian, Sensor, Space, symmetric

from .filter import Correction


def joseph_update(belief: Gaussian, y: Array, sensor: Sensor, state: Space) -> Correction:
    """Fuse the reading ``y`` (k,), with the sensor linearised about the mean.

    ``state`` is the space of the mean, which has its angles wrapped.

    The covariance is in the form of Bucy and Joseph, a sum of two positive semi-definite terms
    for any gain (Bar-Shalom et al., equation 5.2.3-18).

    Raises
    ------
    numpy.linalg.LinAlgError
        If the innovation covariance is not positive definite.
    """
    x, P = belief.mean, belief.covariance
    H, R = sensor.jacobian(x), sensor.covariance
    innovation = sensor.output.subtract(y, sensor.measure(x))
    HP = H.dot(P)  # for small matrices dot takes half the time of @
    S = HP.dot(H.T) + R
    K, nis = gain(S, HP, innovation)
    I_KH = np.eye(len(x)) - K.dot(H)
    covariance = symmetric(I_KH.dot(P).dot(I_KH.T) + K.dot(R).dot(K.T))
    posterior = Gaussian(state.wrap(x + K.dot(innovation)), covariance, belief.repairs)
    return Correction(posterior, innovation, S, nis)


def gain(S: Array, P_yx: Array, innovation: Array) -> tuple[Array, float]:
    """Return the gain K = P_xy S^-1 (n, k) and the normalised innovation squared.

    One Cholesky solve gives both.

    Raises
    ------
    numpy.linalg.LinAlgError
        If ``S`` (k, k) is not positive definite.
    """
    k, n = P_yx.shape
    right = np.empty((k, n + 1))
    right[:, :n], right[:, n] = P_yx, innovation
    _, solved, info = dposv(S, right)
    if info != 0:
        raise np.linalg.LinAlgError('the innovation covariance is not positive definite')
    return solved[:, :n].T, float(innovation.dot(solved[:, n]))
