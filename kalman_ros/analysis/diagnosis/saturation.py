# SPDX-License-Identifier: Apache-2.0
"""Readings at the end of the range of a sensor, or in its dead zone."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from kalman_ros.core import Array

from .examination import Examination
from .finding import Curve, Figure, Finding

#: Fewest readings at an end of the range, as a number and as a share of all.
_FEWEST, _LEAST = 5, 0.003
#: An end is repeated more often than any other value, by this factor.
_OFTEN = 3
#: Mean of normalised squares from which zeros contradict the filter.
_CONTRADICTED = 1.5


def find(case: Examination) -> list[Finding]:
    """Return the coordinates whose largest or smallest value is read again and again.

    Noise does not repeat a number, unless the values have steps: then others are repeated, too.
    """
    findings = []
    for name, record in case.evidence.sensors.items():
        space = case.evidence.scenario.sensors[name].sensor.output
        for index, label in enumerate(space.names):
            if _is_dead(case, name, index):
                findings.append(_dead(case, name, index))
                continue
            column = record.value[:, index]
            ends = [] if label in space.angles else ends_of(column[np.isfinite(column)])
            if ends:
                findings.append(_saturated(case, name, index, ends))
    return findings


def _is_dead(case: Examination, name: str, index: int) -> bool:
    """Return whether a coordinate reads exactly zero again and again where it should not."""
    column = case.evidence.sensors[name].value[:, index]
    levels, counts = np.unique(column[np.isfinite(column)], return_counts=True)
    at_zero = int(counts[levels == 0.0].sum())
    others = counts[levels != 0.0]
    if not len(others) or np.median(others) > 1 or at_zero < max(_FEWEST, _OFTEN * others.max()):
        return False
    nu, S, at = (case.passage.series(field, name) for field in ('innovation', 'S', 'index'))
    if not len(at):
        return False
    squares = (nu[:, index] ** 2 / S[:, index, index])[column[at] == 0.0]
    return len(squares) >= _FEWEST and float(np.mean(squares)) > _CONTRADICTED


def ends_of(values: Array) -> list[float]:
    """Return the ends of the range at which values (N,) stay.

    A value far from all others is no end of a range, but one in place of a reading.
    """
    levels, counts = np.unique(values, return_counts=True)
    if len(levels) < 3 or np.median(counts) > 1:
        return []
    fewest = max(_FEWEST, _LEAST * len(values))
    usual = _OFTEN * int(counts[1:-1].max())
    # the distance of each end to the next value, and the range of all others
    apart = {
        0: (levels[1] - levels[0], levels[-1] - levels[1]),
        -1: (levels[-1] - levels[-2], levels[-2] - levels[0]),
    }
    return [
        float(levels[end])
        for end, (gap, others) in apart.items()
        if counts[end] >= max(fewest, usual) and gap <= others
    ]


def _saturated(case: Examination, name: str, index: int, ends: list[float]) -> Finding:
    at_end = np.isin(case.evidence.sensors[name].value[:, index], ends)
    bounds = ' and '.join(f'{end:.4g}' for end in ends)
    return _finding(
        case, name, index, at_end, 'saturated',
        f'exactly {bounds}: the end of the range of the sensor, beyond which it says nothing.',
    )  # fmt: skip


def _dead(case: Examination, name: str, index: int) -> Finding:
    value = case.evidence.sensors[name].value[:, index]
    least = float(np.abs(value[value != 0.0]).min())
    return _finding(
        case, name, index, value == 0.0, 'dead zone',
        f'exactly 0, and no other is below {least:.3g}: small values are not read at all.',
    )  # fmt: skip


def _finding(
    case: Examination, name: str, index: int, at_end: Any, kind: str, words: str
) -> Finding:
    record = case.evidence.sensors[name]
    label = case.evidence.scenario.sensors[name].sensor.output.names[index]
    times = record.stamp - case.evidence.start
    curves = (Curve(label, times, record.value[:, index], 'dots'),)
    return Finding(
        kind, f'{name}.{label}',
        f'{int(at_end.sum())} of {len(record)} readings of {name}.{label} are {words}',
        inf, figure=Figure(f'{name}: range of {label}', 'time [s]', label, curves),
        mended=lambda: case.evidence.without(name, at_end),
    )  # fmt: skip
