# SPDX-License-Identifier: Apache-2.0
"""Noise that two sensors have in common."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import log1p

import numpy as np

from kalman_ros.core import Array

from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding

#: Fewest pairs of readings, and smallest correlation that is a finding.
_FEWEST, _RELEVANT = 50, 0.1
#: How much larger it is than that of readings after each other, which shows another cause.
_MORE = 2.0
#: The same for the readings of one sensor, which noise in common correlates by the filter.
_ALONE = 1.5
#: Largest difference of the stamps of a pair, as a share of the interval of the sensor.
_TOGETHER = 0.3


def find(case: Examination) -> list[Finding]:
    """Return the pairs of sensors whose innovations at the same time are correlated.

    The whitened innovations of a filter are independent (T. Kailath, An Innovations Approach to
    Least-Squares Estimation, IEEE Trans. Automatic Control 13(6), 1968). Whatever the model lacks
    correlates them, too: this is for a pass in which nothing else is left to be explained.
    """
    findings = [_find(case, *pair) for pair in combinations(case.judged, 2)]
    return [finding for finding in findings if finding is not None]


def clearest(before: Sequence[Finding], after: Sequence[Finding]) -> list[Finding]:
    """Return the findings after all corrections, with those before where these are clearer.

    A correction of the noise of one sensor hides a part of the noise that it shares with another.
    """
    by_subject = {finding.subject: finding for finding in before}
    pairs = ((finding, by_subject.get(finding.subject, finding)) for finding in after)
    return [max(pair, key=lambda finding: finding.gain) for pair in pairs]


def _find(case: Examination, one: str, other: str) -> Finding | None:
    pairs = _pairs(case, one, other)
    if len(pairs) < _FEWEST:
        return None
    A, B = (np.array([case.passage.whitened[i] for i in column]) for column in pairs.T)
    scale = np.sqrt(np.outer(np.mean(A * A, axis=0), np.mean(B * B, axis=0)))
    r = (A.T @ B) / len(A) / np.maximum(scale, 1e-300)
    i, j = np.unravel_index(int(np.argmax(np.abs(r))), r.shape)
    correlation = float(np.clip(r[i, j], -0.999999, 0.999999))
    gain = -len(A) * log1p(-(correlation**2))
    apart = max(_mean_product(A[1:, i], B[:-1, j]), _mean_product(A[:-1, i], B[1:, j]))
    in_time = max(_mean_product(series[1:], series[:-1]) for series in (A[:, i], B[:, j]))
    if gain < CHANCE or abs(correlation) < max(_RELEVANT, _MORE * apart, _ALONE * in_time):
        return None
    sensors = case.evidence.scenario.sensors
    labels = [
        f'{name}.{sensors[name].sensor.output.names[k]}' for name, k in ((one, i), (other, j))
    ]
    curves = (Curve('at the same time', A[:, i], B[:, j], 'dots'),)
    return Finding(
        'correlated noise', f'{one} and {other}',
        f'innovations of {labels[0]} and {labels[1]} at the same time have the correlation '
        f'{correlation:+.2f}: their noise is in part the same (one receiver, one clock, one '
        'vibration). The filter takes them for independent and is surer than it should be: give '
        'both as one sensor with its whole covariance, or use one of them.',
        gain**0.5, gain=gain, figure=Figure('Whitened innovations', labels[0], labels[1], curves),
    )  # fmt: skip


def _mean_product(a: Array, b: Array) -> float:
    """Return the magnitude of the correlation of numbers (N,) of zero mean."""
    return abs(float(a @ b)) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300)


def _pairs(case: Examination, one: str, other: str) -> Array:
    """Return the indices of events of two sensors at the same time (N, 2)."""
    first, second = case.passage.of(one), case.passage.of(other)
    times = case.passage.series('time')
    if len(first) < 2 or len(second) < 2:
        return np.zeros((0, 2), dtype=int)
    right = np.clip(np.searchsorted(times[second], times[first]), 1, len(second) - 1)
    closer = np.where(
        times[first] - times[second][right - 1] < times[second][right] - times[first],
        right - 1, right,
    )  # fmt: skip
    interval = min(np.median(np.diff(times[first])), np.median(np.diff(times[second])))
    together = np.abs(times[second][closer] - times[first]) <= _TOGETHER * interval
    return np.column_stack((first[together], second[closer[together]]))
