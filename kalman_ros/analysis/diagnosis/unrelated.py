# SPDX-License-Identifier: Apache-2.0
"""Readings of something that the model does not have."""

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

#: A sensor is suspected if its innovations squared are larger than expected by this factor.
_SUSPECT = 4.0
#: The events at which the uncertainty of predictions is taken.
_SOME = 50
#: Correlations with all states are looked at within this many seconds, and are none below this.
_LAG, _CORRELATED = 1.0, 0.55
#: The slopes of readings over predictions and of predictions over readings, between which the true
#: one is where both have errors, are this many deviations below 1 (R. Frisch, Statistical
#: Confluence Analysis by Means of Complete Regression Systems, 1934).
_FAR = 4.0
#: The other sensors know what it should read if this varies by more than their uncertainty.
_EXCITED = 1.0
#: Readings beyond these quantiles count as these, so that outliers hide no correlation.
_ORDINARY = (0.05, 0.95)
#: How often the slope and the correlation of the residual are computed in turn.
_REPEATED = 3


@dataclass(frozen=True)
class _Comparison:
    """Readings (N, k) beside what the others predict (N, k), and the correlations between."""

    time: Array
    read: Array
    predicted: Array
    largest: float
    z: float


def find(case: Examination) -> list[Finding]:
    """Return the sensors whose readings have nothing to do with the states of the model.

    The other sensors predict what it should have read. Where they know that well, and the
    readings follow neither this nor any other state, also not later or earlier, they are of
    something else.
    """
    names = dict.fromkeys(event.sensor for event in case.passage.events)
    found = []
    for name in names if len(names) > 1 else ():
        squares = [
            case.passage.whitened[i] @ case.passage.whitened[i] for i in case.passage.of(name)
        ]
        size = case.evidence.scenario.sensors[name].sensor.output.size
        # the median, as outliers are no other signal
        if np.median(squares) > _SUSPECT * 2.0 * gammainccinv(0.5 * size, 0.5):
            found += _judged(case, name)
    return found


def _judged(case: Examination, name: str) -> list[Finding]:
    others = left_out(case, name)
    if others is None:
        return []
    record, without = case.evidence.sensors[name], others.without
    compared = _compared(case, name, others)
    if compared is None or compared.largest > _CORRELATED or compared.z < _FAR:
        return []
    events = [case.passage.events[i] for i in case.passage.of(name)]
    by_itself = _misfit_alone(record.value[[event.index for event in events]])
    unread = sum(event.log + event.innovation.size + DROPPED for event in events)
    dues = by_itself - unread
    label = case.evidence.scenario.sensors[name].sensor.output.names[0]
    time = compared.time - case.evidence.start
    figure = Figure(
        f'{name}: readings beside what the other sensors predict', 'time [s]', label,
        (Curve('readings', time, compared.read[:, 0], 'dots'),
         Curve('predicted', time, compared.predicted[:, 0])),
    )  # fmt: skip
    finding = Finding(
        'unrelated', name,
        f'{name} reads something that the model does not have: it correlates with no state '
        f'(at most {compared.largest:.2f} within {_LAG:g} s), though the other sensors predict '
        'what it should read. Is it the right topic, and the right field?',
        compared.z, {f'{name}.enabled': False}, gain=explained(case.passage, without) - dues,
        figure=figure, dues=dues, mended=lambda: others.evidence,
    )  # fmt: skip
    return [finding]


def _misfit_alone(values: Array) -> float:
    """Return -2 log likelihood of readings (N, k) of which each follows only the one before it.

    A line through successive readings, with normal residuals, in place of the model.
    """
    total = 0.0
    for y in values.T:
        line = np.column_stack((y[:-1], np.ones(len(y) - 1)))
        residual = y[1:] - line @ np.linalg.lstsq(line, y[1:], rcond=None)[0]
        variance = max(float(residual.var()), 1e-300)
        total += len(y) * (LOG_2_PI + np.log(variance) + 1.0)
    return total


def _compared(case: Examination, name: str, others: LeftOut) -> _Comparison | None:
    """Return readings beside predictions; None if they do not suffice to judge."""
    _, _, record, predicted, events = others
    sensor = case.evidence.scenario.sensors[name].sensor
    x = np.array([event.x for event in events])
    some = events[:: max(1, len(events) // _SOME)]
    H, P = [sensor.jacobian(event.x) for event in some], [event.P for event in some]
    unsure = np.median([(h @ p @ h.T).diagonal() for h, p in zip(H, P)], axis=0)
    y, expected = _straight(sensor.output, record.value), _straight(sensor.output, predicted)
    y = np.clip(y, *np.quantile(y, _ORDINARY, axis=0))
    known = expected.var(axis=0) > _EXCITED * unsure
    if not known.any() or not (y.std(axis=0) > 0.0).all():
        return None
    signals = np.column_stack((expected, _straight(case.evidence.scenario.model.state, x)))
    largest = max(_correlated(record, column, signals) for column in y.T)
    z = min(
        _distance(one[:, i], other[:, i])
        for one, other in ((y, expected), (expected, y))
        for i in np.flatnonzero(known)
    )
    return _Comparison(record.stamp, y, expected, largest, z)


def _straight(space: Space, values: Array) -> Array:
    """Return values (N, k) with the sine for each angle."""
    angles = [name in space.angles for name in space.names]
    return np.where(angles, np.sin(values), values)


def _correlated(record: SensorRecord, y: Array, signals: Array) -> float:
    """Return the largest correlation of readings (N,) with signals (N, m), at any lag."""
    interval = max(float(np.median(np.diff(record.stamp))), 1e-6)
    grid = np.arange(record.stamp[0], record.stamp[-1], interval)
    size, lags = 2 * len(grid), int(_LAG / interval)
    keep = np.r_[0 : min(lags, len(grid)), max(size - lags, len(grid)) : size]

    def spectrum(values: Array) -> Array:
        even = np.interp(grid, record.stamp, values)
        even = even - even.mean()
        norm = float(np.linalg.norm(even))
        return np.asarray(np.fft.rfft(even / norm if norm > 0.0 else even, size))

    first = spectrum(y)
    return max(
        float(np.abs(np.fft.irfft(first * spectrum(each).conj(), size)[keep]).max())
        for each in signals.T
    )


def _distance(y: Array, expected: Array) -> float:
    """Return by how many standard deviations the slope of readings over predictions is below 1.

    The residual is taken for autoregressive of first order, and both are whitened by it (D.
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
