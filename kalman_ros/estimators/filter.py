# SPDX-License-Identifier: Apache-2.0
"""What a filter is: two functions from belief to belief. No clock, no history, no mutation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from kalman_ros.core import Array, Gaussian, Sensor


@dataclass(frozen=True)
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
    nis
        The normalised innovation squared, chi-square with k degrees of freedom if the filter is
        consistent (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
        Navigation, section 5.4).
    """

    posterior: Gaussian
    innovation: Array
    innovation_covariance: Array
    nis: float


class Filter(Protocol):
    """A recursive estimator of the state of a model."""

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return the belief ``dt`` seconds later, with the input ``u`` (m,) held."""
        ...

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return what the reading ``y`` (k,) of ``sensor`` makes of the belief.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the innovation covariance is not positive definite.
        """
        ...
