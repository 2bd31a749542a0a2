# SPDX-License-Identifier: Apache-2.0
"""The consistency of an estimator: NEES, NIS and their chi-square bounds.

Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
section 5.4.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from kalman_ros.core import Array


def chi_square_bounds(mean: float, variance: float, miss: float) -> tuple[float, float]:
    """Return the bounds outside of which a positive average lies with probability ``miss``.

    The average is approximated by a scaled chi-square variable of equal mean and variance (F. E.
    Satterthwaite, 1946), which is exact for an average of independent chi-square variables and
    close for the average of a quadratic form along a correlated Gaussian sequence.
    """
    from scipy.special import gammainccinv, gammaincinv  # 0.1 s to import, needed only by reports

    shape = mean**2 / variance
    low, high = gammaincinv(shape, miss / 2.0), gammainccinv(shape, miss / 2.0)
    return float(low * mean / shape), float(high * mean / shape)


def chi_square_gate(probability: float, degrees: float) -> float:
    """Return the quantile at ``probability`` of chi-square with ``degrees`` of freedom."""
    from scipy.special import gammaincinv

    return float(2.0 * gammaincinv(degrees / 2.0, probability))


def nees(error: Array, covariance: Array) -> Array:
    """Return the normalised estimation errors squared (...,).

    Parameters
    ----------
    error
        Truth minus estimate (..., n).
    covariance
        Covariance of the estimate (..., n, n).

    A coordinate reported as certain, with a row of zeros, does not count if its error is zero;
    otherwise the result is infinite.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is singular for another reason.
    """
    error, covariance = _uncertain(error, covariance)
    finite = np.where(np.isinf(error), 0.0, error)
    solved = np.linalg.solve(covariance, finite[..., np.newaxis])[..., 0]
    squares = np.einsum('...i,...i->...', finite, solved)
    return np.where(np.isinf(error).any(axis=-1), np.inf, squares)


def normalised(error: Array, covariance: Array) -> Array:
    """Return L^-1 error (..., n) with L L' = covariance: the sum of its squares is the `nees`.

    A coordinate with zero variance is 0 if its error is zero; otherwise all coordinates are
    infinite.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance is not positive definite for another reason.
    """
    error, covariance = _uncertain(error, covariance)
    L = np.linalg.cholesky(covariance)
    finite = np.where(np.isinf(error), 0.0, error)
    z = np.linalg.solve(L, finite[..., np.newaxis])[..., 0]
    return np.where(np.isinf(error).any(axis=-1, keepdims=True), np.inf, z)


def _uncertain(error: Array, covariance: Array) -> tuple[Array, Array]:
    """Return errors and covariances with a variance of 1 in place of 0.

    An error in such a coordinate becomes infinite.
    """
    certain = np.diagonal(covariance, axis1=-2, axis2=-1) == 0.0
    if not certain.any():
        return error, covariance
    covariance = covariance + certain[..., np.newaxis] * np.eye(error.shape[-1])
    return np.where(certain & (error != 0.0), np.inf, error), covariance


def independent(errors: Array) -> float:
    """Return the number of independent squares equivalent to correlated errors (N, n).

    For one coordinate it is N / (1 + 2 sum (1 - l/N) r_l) with the autocorrelations r_l about the
    mean zero, up to the first that is not positive (C. J. Geyer, Practical Markov Chain Monte
    Carlo, 1992); squares are no more correlated than the values themselves. Variances
    add, so for several coordinates it is the harmonic mean. The scale of the errors cancels.
    """
    N, n = errors.shape
    if not np.isfinite(errors).all():
        return 1.0
    r = np.fft.irfft(np.abs(np.fft.rfft(errors, 2 * N, axis=0)) ** 2, axis=0)[:N]
    r = r[:, r[0] > 0.0] / r[0, r[0] > 0.0]
    positive = np.logical_and.accumulate(r > 0.0)
    # r already has the factor (1 - l/N)
    times = np.maximum(1.0, 2.0 * np.sum(r, axis=0, where=positive) - 1.0)
    return float(N * n / (times.sum() + n - len(times)))


@dataclass
class ChiSquareWindow:
    """The running average of a chi-square statistic over its last ``length`` values.

    Successive values are assumed independent, as the NIS are.
    """

    degrees: int
    length: int = 500
    _values: deque[float] = field(init=False)

    def __post_init__(self) -> None:
        self._values = deque(maxlen=self.length)

    def add(self, value: float) -> None:
        """Add one value."""
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
        """Return whether the average is within its bounds or the window is empty."""
        low, high = self.bounds(miss)
        return not self._values or low <= self.mean <= high


def verdict(windows: Mapping[str, ChiSquareWindow]) -> str:
    """Return the verdict on averages inside their bounds, and the names of the empty windows."""
    sentences = ['consistent'] if any(window.count for window in windows.values()) else []
    sentences += [
        f'no {name} to judge yet' for name, window in windows.items() if not window.count
    ]
    return '; '.join(sentences) or 'nothing to judge'


@dataclass
class NeesWindow(ChiSquareWindow):
    """The running average of the NEES; successive errors are correlated."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._errors: deque[Array] = deque(maxlen=self.length)

    def add_errors(self, errors: Array, covariances: Array) -> None:
        """Add truth minus estimate (N, n); the NEES is infinite without a covariance (N, n, n)."""
        try:
            z = normalised(errors, covariances)
        except np.linalg.LinAlgError:
            z = np.full(errors.shape, np.inf)
            if len(errors) > 1:  # perhaps only some covariances are singular
                for error, covariance in zip(errors, covariances):
                    self.add_errors(error[np.newaxis], covariance[np.newaxis])
                return
        self._errors.extend(z)
        self._values.extend(np.einsum('ki,ki->k', z, z).tolist())

    def _independent(self) -> float:
        return independent(np.array(self._errors)) if self._errors else 0.0
