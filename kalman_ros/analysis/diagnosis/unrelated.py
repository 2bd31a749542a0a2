# SPDX-License-Identifier: Apache-2.0
"""Readings of an unmodelled quantity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammainccinv

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array, Space

from .examination import Examination
from .finding import Curve, Figure, Finding
from .left_out import LeftOut, left_out
from .passage import DROPPED, LOG_2_PI, explained

#: A sensor is suspected if its squared innovations exceed their expectation by this factor.
_SUSPECT = 4.0
#: Number of events at which the uncertainty of predictions is evaluated.
_SOME = 50
#: Largest lag of correlations with states, in seconds, and smallest significant correlation.
_LAG, _CORRELATED = 1.0, 0.55
#: Number of standard deviations by which the slopes of readings over predictions and of
#: predictions over readings are below 1. If both have errors, the true slope is between these two
#: (R. Frisch, Statistical Confluence Analysis by Means of Complete Regression Systems, 1934).
_FAR = 4.0
#: The other sensors predict a reading if the variance of its prediction exceeds its uncertainty by
#: this factor.
_EXCITED = 1.0
#: Readings are limited to these quantiles, so that outliers hide no correlation.
_ORDINARY = (0.05, 0.95)
#: Number of alternating computations of the slope and of the correlation of the residual.
_REPEATED = 3


@dataclass(frozen=True)
class _Comparison:
    """Readings (N, k), leave-one-out predictions (N, k), and the correlations between them."""

    time: Array
    read: Array
    predicted: Array
    largest: float
    z: float


def find(case: Examination) -> list[Finding]:
    """Return the sensors whose readings are unrelated to the states of the model.

    The other sensors predict the readings of a sensor. If the predictions are accurate, and the
    readings follow neither the predictions nor any state, at any lag, they are of an unmodelled
    quantity. It may be one that the filter believes, so that the others look wrong.
    """
    names = case.judged
    if len(names) < 2 or not any(_is_suspect(case, name) for name in names):
        return []
    return [finding for name in names for finding in _examine(case, name)]


def _is_suspect(case: Examination, name: str) -> bool:
    """Return whether most innovations of a sensor are too large: few outliers mean nothing."""
    size = case.evidence.scenario.sensors[name].sensor.output.size
    usual = 2.0 * gammainccinv(0.5 * size, 0.5)
    return bool(np.median(case.passage.squares(name)) > _SUSPECT * usual)


def _examine(case: Examination, name: str) -> list[Finding]:
    others = left_out(case, name)
    if others is None:
        return []
    record, without = case.evidence.sensors[name], others.without
    comparison = _compare(case, name, others)
    if comparison is None or comparison.largest > _CORRELATED or comparison.z < _FAR:
        return []
    misfit_of_line = _misfit_without_model(record.value[case.passage.series('index', name)])
    terms = case.passage.terms(name)
    misfit_omitted = float(np.sum(terms.log + terms.k + DROPPED))
    dues = misfit_of_line - misfit_omitted
    label = case.evidence.scenario.sensors[name].sensor.output.names[0]
    time = comparison.time - case.evidence.start
    figure = Figure(
        f'{name}: readings beside what the other sensors predict', 'time [s]', label,
        (Curve('readings', time, comparison.read[:, 0], 'dots'),
         Curve('predicted', time, comparison.predicted[:, 0])),
    )  # fmt: skip
    finding = Finding(
        'unrelated', name,
        f'{name} reads something that the model does not have: it correlates with no state '
        f'(at most {comparison.largest:.2f} within {_LAG:g} s), though the other sensors predict '
        'what it should read. Is it the right topic, and the right field?',
        comparison.z, {f'{name}.enabled': False}, gain=explained(case.passage, without) - dues,
        figure=figure, dues=dues, mended=lambda: others.evidence,
    )  # fmt: skip
    return [finding]


def _misfit_without_model(values: Array) -> float:
    """Return -2 log likelihood of readings (N, k), each of which depends on the previous one only.

    The model is replaced by a line through successive readings, with normal residuals.
    """
    total = 0.0
    for y in values.T:
        line = np.column_stack((y[:-1], np.ones(len(y) - 1)))
        residual = y[1:] - line @ np.linalg.lstsq(line, y[1:], rcond=None)[0]
        variance = max(float(residual.var()), 1e-300)
        total += len(y) * (LOG_2_PI + np.log(variance) + 1.0)
    return total


def _compare(case: Examination, name: str, others: LeftOut) -> _Comparison | None:
    """Return readings with their predictions; None if they do not suffice."""
    _, without, record, predicted, rows = others
    sensor = case.evidence.scenario.sensors[name].sensor
    x, some = without.series('x')[rows], slice(None, None, max(1, len(rows) // _SOME))
    H, P = np.array([*map(sensor.jacobian, x[some])]), without.series('P')[rows[some]]
    variance = np.median((H @ P @ H.swapaxes(1, 2)).diagonal(axis1=1, axis2=2), axis=0)
    y, expected = (
        _linear_values(sensor.output, record.value),
        _linear_values(sensor.output, predicted),
    )
    y = np.clip(y, *np.quantile(y, _ORDINARY, axis=0))
    excited = expected.var(axis=0) > _EXCITED * variance
    if not excited.any() or not (y.std(axis=0) > 0.0).all():
        return None
    signals = np.column_stack((expected, _linear_values(case.evidence.scenario.model.state, x)))
    largest = _largest_correlation(record, y, signals)
    z = min(
        _slope_deviation(one[:, i], other[:, i])
        for one, other in ((y, expected), (expected, y))
        for i in np.flatnonzero(excited)
    )
    return _Comparison(record.stamp, y, expected, largest, z)


def _linear_values(space: Space, values: Array) -> Array:
    """Return values (N, k) with each angle replaced by its sine."""
    angles = [name in space.angles for name in space.names]
    return np.where(angles, np.sin(values), values)


def _largest_correlation(record: SensorRecord, y: Array, signals: Array) -> float:
    """Return the largest correlation of readings (N, k) with signals (N, m), at any lag."""
    interval = max(float(np.median(np.diff(record.stamp))), 1e-6)
    grid = np.arange(record.stamp[0], record.stamp[-1], interval)
    lags = max(int(_LAG / interval), 1)
    size = 1 << (2 * len(grid) - 1).bit_length()  # a fast length, with room for all lags
    kept_lags = np.r_[0 : min(lags + 1, len(grid)), max(size - lags, len(grid)) : size]

    def spectrum(values: Array) -> Array:
        resampled = np.interp(grid, record.stamp, values)
        resampled = resampled - resampled.mean()
        norm = float(np.linalg.norm(resampled))
        return np.asarray(np.fft.rfft(resampled / norm if norm > 0.0 else resampled, size))

    conjugates = [spectrum(signal).conj() for signal in signals.T]
    return max(
        float(np.abs(np.fft.irfft(first * other, size)[kept_lags]).max())
        for first in map(spectrum, y.T)
        for other in conjugates
    )


def _slope_deviation(y: Array, expected: Array) -> float:
    """Return the deviation below 1 of the slope of readings over predictions, in sigmas.

    The residual is modelled as autoregressive of first order, and both are whitened by it (D.
    Cochrane and G. Orcutt, Application of Least Squares Regression to Relationships Containing
    Auto-correlated Error Terms, J. American Statistical Association 44(245), 1949).
    """
    y, expected = y - y.mean(), expected - expected.mean()
    slope = 0.0
    for _ in range(_REPEATED):
        residual = y - slope * expected
        r = min(max(float(residual[1:] @ residual[:-1] / (residual @ residual)), 0.0), 0.999)
        white_y, white = y[1:] - r * y[:-1], expected[1:] - r * expected[:-1]
        information = float(white @ white)
        if information <= 0.0:
            return 0.0
        slope = float(white @ white_y) / information
    std = float(np.std(white_y - slope * white)) / information**0.5
    return float((1.0 - abs(slope)) / max(std, 1e-300))
