# SPDX-License-Identifier: Apache-2.0
"""The measurement update that the linear and the extended filter share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, Gaussian, Model, Sensor, identity, unchecked
from kalman_ros.linear.lapack import dgemm, dgemv, dposv, dsymm

from .correction import Correction


@dataclass(frozen=True)
class LinearUpdate:
    """What filters have in common that linearise a sensor about the mean.

    Parameters
    ----------
    model
        How the state moves.
    """

    model: Model

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Fuse a reading.

        The covariance is in the form of Bucy and Joseph, a sum of two positive semi-definite
        terms for any gain (Bar-Shalom et al., equation 5.2.3-18).
        """
        x, P, repairs = belief
        H, R = np.asfortranarray(sensor.jacobian(x)), sensor.covariance.T
        innovation = sensor.output.subtract(y, sensor.measure(x))
        HP = dgemm(1.0, H, P)
        S = dgemm(1.0, HP, H, 1.0, R, 0, 1)  # H P H' + R
        Kt = transposed_gain(S, HP)
        eye = identity(x.size)
        I_KH = dgemm(-1.0, Kt, H, 1.0, eye, 1)
        KRK = dgemm(1.0, dgemm(1.0, Kt, R, 0.0, None, 1), Kt)
        joseph = dgemm(1.0, dgemm(1.0, I_KH, P), I_KH, 1.0, KRK, 0, 1, 1)
        mean = dgemv(1.0, Kt, innovation, 1.0, x, 0, 1, 0, 1, 1)  # x + K innovation
        P = dsymm(1.0, joseph, eye)  # symmetric to the last bit
        posterior = unchecked((self.model.state.wrap(mean), P, repairs))
        return Correction(posterior, innovation, S)


def transposed_gain(S: Array, P_yx: Array) -> Array:
    """Return K' = S^-1 P_yx (k, n), the transpose of the gain, by a Cholesky factor of S.

    Raises
    ------
    numpy.linalg.LinAlgError
        If ``S`` (k, k) is not positive definite.
    """
    _, solved, info = dposv(S, P_yx)
    if info != 0:
        raise np.linalg.LinAlgError('the innovation covariance is not positive definite')
    Kt: Array = solved
    return Kt
