# SPDX-License-Identifier: Apache-2.0
"""The Allan deviation of an inertial sensor at rest, and the noise parameters that it shows.

W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008),
sections 5.2.4 (overlapping estimate) and 5.4.1 (degrees of freedom); IEEE Std 952-1997, annex C
(noise terms of a gyro).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array
from kalman_ros.estimators.consistency import chi_square_bounds

#: Number of averaging times per decade, and the longest one as a share of the recording.
_PER_DECADE, _LONGEST = 12, 1.0 / 3.0
#: Relative error of the three-term model of the variance, which widens the intervals: filters
#: inside a sensor bend the curve at short averaging times.
_MODEL_ERROR = 0.05
#: A parameter is undetermined if its interval spans more than this factor.
_DETERMINED = 3.0
#: Ratio of the flat part of the curve to the bias instability (IEEE 952, C.1.3).
_FLAT = float(np.sqrt(2.0 * np.log(2.0) / np.pi))
#: Probability that the interval misses the value.
_MISS = 0.05
#: The smallest number of readings.
_FEWEST = 100


@dataclass(frozen=True)
class Parameter:
    """A noise parameter, the ends of its 95 % interval, and its averaging time in s.

    The interval is evaluated at the averaging time that shows the parameter best.
    """

    value: float
    low: float
    high: float
    time: float

    @property
    def determined(self) -> bool:
        """Whether the recording determines the parameter within a factor of three."""
        return self.low > 0.0 and self.high < _DETERMINED * self.low


@dataclass(frozen=True)
class Allan:
    """The Allan deviation of one channel, in the channel's unit.

    Parameters
    ----------
    time
        Averaging times (k,), in s.
    deviation, low, high
        Allan deviation (k,) and the ends of its 95 % interval.
    terms
        Variance (k, 3) that the fitted white noise, bias instability and random walk explain.
    density
        Density of the white noise, in unit/sqrt(Hz).
    instability
        Bias instability, in the unit of the channel.
    random_walk
        Random walk of the bias, in unit/sqrt(s).
    duration
        Duration of the recording, in s.
    """

    time: Array
    deviation: Array
    low: Array
    high: Array
    terms: Array
    density: Parameter
    instability: Parameter
    random_walk: Parameter
    duration: float

    def needed(self) -> float:
        """Return the duration of a recording, in s, that may determine the bias instability.

        The degrees of freedom grow in proportion to the duration. Where the curve only falls, a
        recording ten times as long shows a bias instability that is smaller by sqrt(10).
        """
        instability = self.instability
        if instability.determined:
            return self.duration
        if instability.low <= 0.0:
            return 10.0 * self.duration
        log_ratio, log_target = np.log(instability.high / instability.low), np.log(_DETERMINED)
        return float(self.duration * min(max((log_ratio / log_target) ** 2, 1.0), 10.0))


def overlapping_variance(values: Array, factors: npt.NDArray[np.intp]) -> Array:
    """Return the overlapping Allan variance (k,) of samples (N,) at averaging factors (k,).

    NIST SP 1065, equation 9: the mean of (x[j+2m] - 2 x[j+m] + x[j])^2 / (2 m^2), where x is
    the running sum of the samples.
    """
    sums = np.concatenate(([0.0], np.cumsum(values - values.mean())))
    variances = []
    for m in factors.tolist():
        differences = sums[2 * m :] - 2.0 * sums[m:-m] + sums[: -2 * m]
        variances.append(differences @ differences / (2.0 * m**2 * len(differences)))
    return np.array(variances)


def allan(values: Array, period: float) -> Allan:
    """Return the Allan deviation of a sensor at rest, and its noise parameters.

    Parameters
    ----------
    values
        Readings (N,).
    period
        Sampling period of the readings, in s.

    Raises
    ------
    ValueError
        If there are fewer than 100 readings, or if they are not finite or never change.
    """
    count = len(values)
    if count < _FEWEST:
        raise ValueError(f'expected at least {_FEWEST} readings, got {count}')
    if not np.isfinite(values).all():
        raise ValueError('expected finite readings')
    if np.ptp(values) == 0.0:
        raise ValueError('all readings are equal: the sensor is frozen, or not connected')
    decades = np.log10(count * _LONGEST)
    grid = np.logspace(0.0, decades, max(2, round(decades * _PER_DECADE)))
    factors = np.unique(grid.astype(np.intp))
    variance: Array = overlapping_variance(values, factors)
    time: Array = (factors * period).astype(np.float64)
    basis = np.stack([1.0 / time, np.full_like(time, _FLAT**2), time / 3.0], axis=1)
    degrees = _degrees(count + 1, factors, np.zeros(len(factors), np.intp))
    for _ in range(5):  # the dominant term and the degrees of freedom depend on each other
        squares = _fit_terms(basis, variance, degrees)
        terms = basis * squares
        degrees = _degrees(count + 1, factors, terms.argmax(axis=1))
    low, high = np.transpose([_variance_interval(v, d) for v, d in zip(variance, degrees)])
    density, instability, random_walk = (
        _noise_parameter(squares, terms, degrees, time, index) for index in range(3)
    )
    return Allan(
        time=time,
        deviation=np.sqrt(variance),
        low=np.sqrt(low),
        high=np.sqrt(high),
        terms=terms,
        density=density,
        instability=instability,
        random_walk=random_walk,
        duration=count * period,
    )


def _fit_terms(basis: Array, variance: Array, degrees: Array) -> Array:
    """Fit the non-negative weights (3,) of the terms by relative least squares."""
    from scipy.optimize import nnls

    scale = variance * np.sqrt(2.0 / degrees + _MODEL_ERROR**2)
    return np.asarray(nnls(basis / scale[:, np.newaxis], variance / scale)[0])


def _degrees(N: int, m: npt.NDArray[np.intp], kind: npt.NDArray[np.intp]) -> Array:
    """Return the degrees of freedom (k,) at averaging factors m (k,).

    ``kind`` (k,) selects white (0), flicker (1) or random-walk noise (2). NIST SP 1065, table 5,
    with N running sums.
    """
    white = (1.5 * (N - 1) / m - 2.0 * (N - 2) / N) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    flicker = np.where(
        m == 1, 2.0 * (N - 2) ** 2 / (2.3 * N - 4.9), 5.0 * N**2 / (4.0 * m * (N + 3.0 * m))
    )
    walk = (N - 2) / m * ((N - 1) ** 2 - 3.0 * m * (N - 1) + 4.0 * m**2) / (N - 3.0) ** 2
    degrees = np.choose(kind, [white, flicker, walk])
    return np.asarray(np.maximum(degrees, 1.0), dtype=np.float64)


def _variance_interval(variance: float, degrees: float) -> tuple[float, float]:
    """Return the 95 % interval of a variance estimated with ``degrees`` of freedom."""
    low, high = chi_square_bounds(1.0, 2.0 / degrees, _MISS)
    return variance / high, variance / low


def _noise_parameter(
    squares: Array, terms: Array, degrees: Array, time: Array, index: int
) -> Parameter:
    """Return a parameter with its interval at the averaging time that shows it best."""
    shares = terms[:, index] / terms.sum(axis=1)
    effective = 2.0 / (2.0 / degrees + _MODEL_ERROR**2) * shares**2
    best = int(effective.argmax())
    value = float(np.sqrt(squares[index]))
    if effective[best] < 1.0:
        return Parameter(value, 0.0, float('inf'), float(time[best]))
    low, high = _variance_interval(squares[index], effective[best])
    return Parameter(value, float(np.sqrt(low)), float(np.sqrt(high)), float(time[best]))
