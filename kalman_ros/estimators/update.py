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
    for any gain (Bar-Shalom et al., equation 5.2.3-18). One Cholesky solve gives the gain and
    the normalised innovation squared.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the innovation covariance is not positive definite.
    """
    x, P = belief.mean, belief.covariance
    H, R = sensor.jacobian(x), sensor.covariance
    innovation = sensor.output.subtract(y, sensor.measure(x))
    HP = H @ P
    S = HP @ H.T + R
    k, n = H.shape
    right = np.empty((k, n + 1))
    right[:, :n], right[:, n] = HP, innovation
    _, solved, info = dposv(S, right)
    if info != 0:
        raise np.linalg.LinAlgError('the innovation covariance is not positive definite')
    K = solved[:, :n].T
    I_KH = np.eye(n) - K @ H
    covariance = symmetric(I_KH @ P @ I_KH.T + K @ R @ K.T)
    posterior = Gaussian(state.wrap(x + K @ innovation), covariance, belief.repairs)
    return Correction(posterior, innovation, S, float(innovation @ solved[:, n]))
