# SPDX-License-Identifier: Apache-2.0
"""What a filter makes of a reading, and the update that KF and EKF share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, Gaussian, Model, Sensor, is_finite, unchecked
from kalman_ros.linear.factor import cholesky
from kalman_ros.linear.kernels import corrected, gain, joseph, weighed


class Correction:
    """A corrected belief with its innovation.

    Parameters
    ----------
    posterior
        The belief after the reading.
    innovation
        The reading minus its prediction (k,).
    innovation_covariance
        S (k, k), what the innovation was expected to scatter by.
    nis
        The normalised innovation squared where the forecast was not one Gaussian.
    """

    __slots__ = ('_nis', 'innovation', 'innovation_covariance', 'posterior')

    def __init__(
        self,
        posterior: Gaussian,
        innovation: Array,
        innovation_covariance: Array,
        nis: float | None = None,
    ) -> None:
        self.posterior = posterior
        self.innovation = innovation
        self.innovation_covariance = innovation_covariance
        self._nis = nis

    @property
    def nis(self) -> float:
        """The normalised innovation squared, innovation' S^-1 innovation.

        It is chi-square with k degrees of freedom if the filter is consistent (Bar-Shalom, Li
        and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4).
        Infinite if S is not positive definite.
        """
        if self._nis is None:
            self._nis = weighed(self.innovation_covariance, self.innovation)
        return self._nis

    def __repr__(self) -> str:
        """Return innovation and NIS, and the mean of the posterior."""
        shown = (np.array2string(a, precision=4) for a in (self.innovation, self.posterior.mean))
        innovation, mean = shown
        k = self.innovation.size
        return f'Correction(innovation {innovation}, NIS {self.nis:.4g} of {k}, mean {mean})'


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
        """Return x + K innovation, (I - K H) P (I - K H)' + K R K', with K = P H' S^-1."""
        x, P = belief
        H, R = np.asfortranarray(sensor.jacobian(x)), sensor.covariance.T
        innovation = sensor.output.subtract(y, sensor.measure(x))
        K, S = gain(P, H, R)
        moved = self.model.state.arrived(corrected(x, K, innovation), x, joseph(K, H, P, R))
        return Correction(unchecked(moved), innovation, S)


def committed(belief: Gaussian) -> tuple[Gaussian, int]:
    """Return a finite and positive definite belief, and the number of repairs.

    Raises
    ------
    numpy.linalg.LinAlgError
        If that is impossible.
    """
    if not is_finite(belief.mean):
        raise np.linalg.LinAlgError('the estimate is not finite')
    _, P, repairs = cholesky(belief.covariance)
    return (Gaussian(belief.mean, P) if repairs else belief), repairs
