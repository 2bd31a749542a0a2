# SPDX-License-Identifier: Apache-2.0
"""What a filter makes of a reading, and the update of filters that linearise a sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array, Dynamics, Gaussian, Sensor, is_finite, unchecked
from kalman_ros.linear.factor import cholesky
from kalman_ros.linear.kernels import kernels

from .filter import SmoothableFilter


class Correction:
    """A corrected belief with its innovation; with leading axes, many of them.

    Parameters
    ----------
    posterior
        The belief after the reading.
    innovation
        The reading minus its prediction (..., k).
    innovation_covariance
        S (..., k, k), what the innovation was expected to scatter by.
    gain
        K (..., n, k), by which the innovation moved the mean; None for a mixture.
    jacobian
        H (..., k, n), the sensor about the mean before, where the filter has one.
    nis
        The normalised innovation squared, if it is known.
    """

    __slots__ = ('_nis', 'gain', 'innovation', 'innovation_covariance', 'jacobian', 'posterior')

    def __init__(
        self,
        posterior: Gaussian,
        innovation: Array,
        innovation_covariance: Array,
        gain: Array | None = None,
        jacobian: Array | None = None,
        nis: Any = None,
    ) -> None:
        self.posterior = posterior
        self.innovation = innovation
        self.innovation_covariance = innovation_covariance
        self.gain = gain
        self.jacobian = jacobian
        self._nis = nis

    @property
    def nis(self) -> Any:
        """The normalised innovation squared, innovation' S^-1 innovation (...,).

        It is chi-square with k degrees of freedom if the filter is consistent (Bar-Shalom, Li
        and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4).
        Infinite if S is not positive definite.
        """
        if self._nis is None:
            weighed = kernels(self.innovation).weighed
            self._nis = weighed(self.innovation_covariance, self.innovation)
        return self._nis

    @property
    def log_likelihood(self) -> Any:
        """The log of the density of the reading (...,), by the prediction-error decomposition.

        A. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989),
        section 3.4.
        """
        _, size = np.linalg.slogdet(2.0 * np.pi * self.innovation_covariance)
        return -0.5 * (self.nis + size)

    def with_posterior(self, posterior: Gaussian) -> Correction:
        """Return the same correction with another belief after it."""
        S, K, H = self.innovation_covariance, self.gain, self.jacobian
        return Correction(posterior, self.innovation, S, K, H, self._nis)

    def __repr__(self) -> str:
        """Return innovation and NIS, and the mean of the posterior."""
        shown = (np.array2string(a, precision=4) for a in (self.innovation, self.posterior.mean))
        innovation, mean = shown
        k = self.innovation.size
        return f'Correction(innovation {innovation}, NIS {self.nis:.4g} of {k}, mean {mean})'


@dataclass(frozen=True)
class LinearUpdate(SmoothableFilter):
    """What filters have in common that linearise a sensor about the mean.

    Parameters
    ----------
    model
        How the state moves.
    """

    model: Dynamics

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return x + K innovation, (I - K H) P (I - K H)' + K R K', with K = P H' S^-1."""
        x, P = belief
        k = kernels(x)
        H, R = k.ordered(sensor.jacobian(x), sensor.covariance)
        innovation = sensor.output.subtract(y, sensor.measure(x))
        K, S = k.gain(P, H, R)
        mean, covariance = k.corrected(x, K, innovation), k.joseph(K, H, P, R)
        moved = self.model.state.arrived(mean, x, covariance)
        return Correction(unchecked(moved), innovation, S, K, H)


def committed(belief: Gaussian) -> tuple[Gaussian, int]:
    """Return a finite and positive definite belief, and the number of repairs.

    Raises
    ------
    numpy.linalg.LinAlgError
        If that is impossible.
    """
    if not is_finite(belief.mean):
        raise np.linalg.LinAlgError('the estimate is not finite')
    if belief.factor is not None and is_finite(belief.factor):
        return belief, 0  # L L' is definite, whatever rounding makes of it
    _, P, repairs = cholesky(belief.covariance)
    return (Gaussian(belief.mean, P) if repairs else belief), repairs
