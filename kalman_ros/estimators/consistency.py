# SPDX-License-Identifier: Apache-2.0
"""The consistency of an estimator: NEES, NIS and their chi-square bounds.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
section 5.4.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from kalman_ros.core import Array


def chi_square_bounds(mean: float, variance: float, miss: float) -> tuple[float, float]:
    """Return the two-sided bounds that such a positive average leaves with probability ``miss``.

    The average is taken for a scaled chi-square variable with this mean and variance (F. E.
    Satterthwaite, 1946), which is exact for an average of independent chi-square variables and
    close for the average of a quadratic form along a correlated Gaussian sequence.
    """
    from scipy.special import gammainccinv, gammaincinv  # 0.1 s to import, for reports alone

    shape = mean**2 / variance
    low, high = gammaincinv(shape, miss / 2.0), gammainccinv(shape, miss / 2.0)
    return float(low * mean / shape), float(high * mean / shape)


def chi_square_gate(probability: float, degrees: int) -> float:
    """Return the value that chi-square with ``degrees`` stays below with ``probability``."""
    from scipy.special import gammaincinv

    return float(2.0 * gammaincinv(degrees / 2.0, probability))


def nees(error: Array, covariance: Array) -> Array:
    """Return the normalised estimation errors squared (...,).

    Parameters
    ----------
    error
        Truth minus estimate (..., n).
    covariance
        The covariance that the estimator gave (..., n, n).

    A coordinate that is said to be certain, with a row of zeros, and is without error, does not
    count; with an error the result is infinite.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is singular otherwise.
    """
    certain = np.diagonal(covariance, axis1=-2, axis2=-1) == 0.0
    if certain.any():
        covariance = covariance + certain[..., np.newaxis] * np.eye(error.shape[-1])
        error = np.where(certain & (error != 0.0), np.inf, error)
        # an infinite error must not meet a zero of the inverse
        return np.where(np.isinf(error).any(axis=-1), np.inf, _squares(error, covariance))
    return _squares(error, covariance)


def _squares(error: Array, covariance: Array) -> Array:
    finite = np.where(np.isfinite(error), error, 0.0)
    solved = np.linalg.solve(covariance, finite[..., np.newaxis])[..., 0]
    return np.asarray(np.einsum('...i,...i->...', finite, solved))


def normalised(error: Array, covariance: Array) -> Array:
    """Return L^-1 error (n,) with L L' = covariance: its square is the NEES.

    A coordinate that is said to be certain and is without error is 0, else infinite.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance is not positive definite otherwise.
    """
    certain = covariance.diagonal() == 0.0
    if error[certain].any():
        return np.full(error.shape, np.inf)
    L = np.linalg.cholesky(covariance + np.diag(certain.astype(float)))
    return np.asarray(np.linalg.solve(L, error))


def independent(errors: Array) -> float:
    """Return how many independent squares are worth as much as those of correlated errors (N, n).

    Of one coordinate that is N / (1 + 2 sum (1 - l/N) r_l) with its correlations r_l, as the mean
    is zero, up to the first that is not positive (C. J. Geyer, Practical Markov Chain Monte
    Carlo, 1992); squares are correlated by no more than what they are squares of. Variances
    add, so of all coordinates it is the harmonic mean. How large the errors are does not matter.
    """
    N, n = errors.shape
    if not np.isfinite(errors).all():
        return 1.0
    r = np.fft.irfft(np.abs(np.fft.rfft(errors, 2 * N, axis=0)) ** 2, axis=0)[:N]
    r = r[:, r[0] > 0.0] / r[0, r[0] > 0.0]
    positive = np.logical_and.accumulate(r > 0.0)
    # r has the factor (1 - l/N) already
    times = np.maximum(1.0, 2.0 * np.sum(r, axis=0, where=positive) - 1.0)
    return float(N * n / (times.sum() + n - len(times)))


@dataclass
class ChiSquareWindow:
    """The running average of a chi-square statistic over its last ``length`` values.

    Successive values are taken for independent, as the NIS are.
    """

    degrees: int
    length: int = 500
    _values: deque[float] = field(init=False)

    def __post_init__(self) -> None:
        self._values = deque(maxlen=self.length)

    def add(self, value: float) -> None:
        """Take one value in."""
        self._values.append(value)

    @property
    def count(self) -> int:
        """The number of values in the window."""
        return len(self._values)

    @property
    def mean(self) -> float:
        """The average divided by its expectation: 1 for a consistent filter; NaN when empty."""
        return float(np.mean(self._values)) / self.degrees if self._values else float('nan')

    def bounds(self, miss: float = 0.001) -> tuple[float, float]:
        """Return the bounds of `mean` for a consistent filter."""
        return chi_square_bounds(1.0, 2.0 / (self.degrees * max(1.0, self._independent())), miss)

    def _independent(self) -> float:
        return self.count

    def inside(self, miss: float = 0.001) -> bool:
        """Tell whether the average is within its bounds; an empty window is."""
        low, high = self.bounds(miss)
        return not self._values or low <= self.mean <= high


@dataclass
class NeesWindow(ChiSquareWindow):
    """The running average of the NEES; successive errors are correlated."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._errors: deque[Array] = deque(maxlen=self.length)

    def add_error(self, error: Array, covariance: Array) -> None:
        """Take in truth minus estimate (n,); of no covariance, its NEES is infinite."""
        try:
            z = normalised(error, covariance)
        except np.linalg.LinAlgError:
            z = np.full(error.shape, np.inf)
        self._errors.append(z)
        self.add(float(z @ z))

    def _independent(self) -> float:
        return independent(np.array(self._errors)) if self._errors else 0.0
