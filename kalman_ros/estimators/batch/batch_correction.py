# SPDX-License-Identifier: Apache-2.0
"""What batched filters make of readings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import log, pi

import numpy as np

from kalman_ros.core import Array, Gaussian
from kalman_ros.linear.batched import factor, log_determinant, times, whitened


@dataclass(frozen=True, eq=False)
class BatchCorrection:
    """Corrected beliefs with their innovations; the batched `Correction`.

    Parameters
    ----------
    posterior
        The beliefs after the readings.
    innovation
        The readings minus their predictions (..., k).
    innovation_covariance
        S (..., k, k), or the same (k, k) for all.
    whitening
        L^-1 (k, k) with L L' = S, where it is known for all.
    """

    posterior: Gaussian
    innovation: Array
    innovation_covariance: Array
    whitening: Array | None = None

    @cached_property
    def factor(self) -> Array:
        """The factor of S; NaN where S is not positive definite."""
        return factor(self.innovation_covariance)

    @cached_property
    def nis(self) -> Array:
        """The normalised innovations squared (...,); infinite where S is not definite."""
        if self.whitening is not None:
            return _squares(times(self.whitening, self.innovation))
        squares = _squares(whitened(self.factor, self.innovation))
        definite = np.isfinite(self.factor).all(axis=(-2, -1))
        return np.where(definite, squares, np.inf)

    @cached_property
    def log_likelihood(self) -> Array:
        """The log of the density of the readings (...,), by the prediction-error decomposition.

        A. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989),
        section 3.4.
        """
        k = self.innovation.shape[-1]
        total = self.nis + log_determinant(self.factor) + k * log(2.0 * pi)
        return np.asarray(-0.5 * total)


def _squares(z: Array) -> Array:
    return np.asarray(np.einsum('...i,...i->...', z, z))
