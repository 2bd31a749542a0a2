# SPDX-License-Identifier: Apache-2.0
"""What a filter makes of a reading."""

from __future__ import annotations

from kalman_ros.core import Array, Gaussian
from kalman_ros.linear.kernels import weighed


class Correction:
    """What one reading did to a belief.

    Parameters
    ----------
    posterior
        The belief after the reading.
    innovation
        The reading minus its prediction (k,).
    innovation_covariance
        S (k, k), what the innovation was expected to scatter by.
    """

    __slots__ = ('_nis', 'innovation', 'innovation_covariance', 'posterior')

    def __init__(
        self, posterior: Gaussian, innovation: Array, innovation_covariance: Array
    ) -> None:
        self.posterior = posterior
        self.innovation = innovation
        self.innovation_covariance = innovation_covariance
        self._nis: float | None = None

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
