# SPDX-License-Identifier: Apache-2.0
"""Quantised readings, by few bits or by rounding."""

from __future__ import annotations

from functools import partial
from math import inf

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array

from .examination import Examination
from .finding import Curve, Figure, Finding

#: Steps below the first share of the declared standard deviation are harmless; those above the
#: second one may be those of another unit.
_HARMLESS, _ABSURD = 0.5, 100.0
#: Two values are steps if they change this often.
_OFTEN = 20


def find(case: Examination) -> list[Finding]:
    """Return the coordinates whose values are multiples of a relevant step.

    Rounding to a step q adds the variance q^2 / 12 (B. Widrow, Statistical Analysis of
    Amplitude-Quantized Sampled-Data Systems, Trans. AIEE 79(2), 1961).
    """
    findings = []
    for name, record in case.evidence.sensors.items():
        source = case.evidence.scenario.sensors[name]
        finite = record.value[np.isfinite(record.value).all(axis=1)]
        for index, label in enumerate(source.sensor.output.names):
            std = float(np.sqrt(source.sensor.covariance[index, index]))
            step = grid(finite[:, index])
            if step is None or step < _HARMLESS * std:
                continue
            noise = np.sqrt(source.sensor.covariance.diagonal())
            noise[index] = np.hypot(std, step / np.sqrt(12.0))
            change = {f'{name}.noise': [float(f'{value:.3g}') for value in noise]}
            absurd = step > _ABSURD * std
            points = record.stamp - case.evidence.start, record.value[:, index]
            findings.append(
                Finding(
                    'quantised',
                    f'{name}.{label}',
                    f'{name}.{label} has steps of {step:.3g}, {step / std:.2g} times its '
                    f'declared noise: rounding adds {step / np.sqrt(12.0):.2g} to it'
                    f'{", or its unit is another" if absurd else ""}.',
                    inf,
                    {} if absurd else change,
                    figure=Figure(
                        f'{name}: steps of {label}',
                        'time [s]',
                        label,
                        (Curve(label, *points, 'dots'),),
                    ),
                    mended=None if absurd else partial(case.evidence.adopting, change),
                    note=absurd,
                )
            )
    return findings


def rounding(record: SensorRecord) -> Array:
    """Return the standard deviation (k,) of readings by rounding alone; 0 where there is none."""
    steps = [grid(column[np.isfinite(column)]) for column in record.value.T]
    return np.asarray([0.0 if step is None else step / np.sqrt(12.0) for step in steps])


def grid(values: Array) -> float | None:
    """Return the step of which all values are multiples; None if there is none."""
    levels = np.unique(values)
    once = len(levels) == 2 and np.count_nonzero(np.diff(values)) < _OFTEN
    if not 2 <= len(levels) <= 0.6 * len(values) or once:
        return None
    gaps = np.diff(levels)
    step = float(gaps[gaps > 1e-9 * max(1.0, float(np.abs(levels).max()))].min(initial=inf))
    if not np.isfinite(step):
        return None
    multiples = gaps / step
    return step if np.abs(multiples - np.round(multiples)).max() < 0.01 else None
