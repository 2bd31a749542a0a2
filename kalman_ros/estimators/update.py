# SPDX-License-Identifier: Apache-2.0
"""The measurement update that the linear and linearised filters share."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, Space, identity, mirrored

from .correction import Correction
from .lapack import dposv


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
    S = HP.dot(H.T)
    S += R
    K = gain(S, HP)
    I_KH = identity(x.size) - K.dot(H)
    joseph = I_KH.dot(P).dot(I_KH.T)
    joseph += K.dot(R).dot(K.T)
    mean = K.dot(innovation)
    mean += x
    posterior = Gaussian(state.wrap(mean), mirrored(joseph), belief.repairs)
    return Correction(posterior, innovation, S)


def gain(S: Array, P_yx: Array) -> Array:
    """Return the gain K = P_xy S^-1 (n, k), by a Cholesky factor of S.

    Raises
    ------
    numpy.linalg.LinAlgError
        If ``S`` (k, k) is not positive definite.
    """
    _, solved, info = dposv(S, P_yx)
    if info != 0:
        raise np.linalg.LinAlgError('the innovation covariance is not positive definite')
    K: Array = solved.T
    return K
