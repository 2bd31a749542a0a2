# SPDX-License-Identifier: Apache-2.0
"""Readings at the end of the range of a sensor."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from kalman_ros.core import Array

from .evidence import Evidence
from .examination import Examination
from .finding import Curve, Figure, Finding

#: Fewest readings at an end of the range, as a number and as a share of all.
_FEWEST, _LEAST = 5, 0.003
#: An end is repeated more often than any other value, by this factor.
_OFTEN = 3


def find(case: Examination) -> list[Finding]:
    """Return the coordinates whose largest or smallest value is read again and again.

    Noise does not repeat a number, unless the values have steps: then others are repeated, too.
    """
    findings = []
    for name, record in case.evidence.sensors.items():
        space = case.evidence.scenario.sensors[name].sensor.output
        for index, label in enumerate(space.names):
            column = record.value[:, index]
            ends = [] if label in space.angles else ends_of(column[np.isfinite(column)])
            if ends:
                findings.append(_finding(case, name, index, ends))
    return findings


def ends_of(values: Array) -> list[float]:
    """Return the ends of the range at which values (N,) stay."""
    levels, counts = np.unique(values, return_counts=True)
    if len(levels) < 3 or np.median(counts) > 1:
        return []
    fewest = max(_FEWEST, _LEAST * len(values))
    usual = _OFTEN * int(counts[1:-1].max())
    return [float(levels[i]) for i in (0, -1) if counts[i] >= max(fewest, usual)]


def _finding(case: Examination, name: str, index: int, ends: list[float]) -> Finding:
    record = case.evidence.sensors[name]
    label = case.evidence.scenario.sensors[name].sensor.output.names[index]
    at_end = np.isin(record.value[:, index], ends)

    def mended() -> Evidence:
        value = record.value.copy()
        value[at_end] = np.nan
        return case.evidence.with_sensor(name, replace(record, value=value))

    times = record.stamp - case.evidence.start
    curves = (Curve(label, times, record.value[:, index], 'dots'),)
    bounds = ' and '.join(f'{end:.4g}' for end in ends)
    return Finding(
        'saturated', f'{name}.{label}',
        f'{int(at_end.sum())} of {len(record)} readings of {name}.{label} are exactly {bounds}: '
        'the end of the range of the sensor, beyond which it says nothing.',
        inf, figure=Figure(f'{name}: range of {label}', 'time [s]', label, curves), mended=mended,
    )  # fmt: skip
