# SPDX-License-Identifier: Apache-2.0
"""Invalid covariances in messages: zero, negative, or absurd."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array

from .evidence import Evidence
from .examination import Examination
from .finding import Finding

#: Standard deviations that differ from the configured ones by more than this factor are absurd.
_ABSURD = 1e3


def find(case: Examination) -> list[Finding]:
    """Return the sensors whose messages contain an invalid covariance."""
    findings = []
    for name, record in case.evidence.sensors.items():
        if len(record):
            R = case.evidence.scenario.sensors[name].sensor.covariance
            findings += [*_sensor_findings(case.evidence, name, record, R)]
    return findings


def _sensor_findings(
    evidence: Evidence, name: str, record: SensorRecord, R: Array
) -> Iterator[Finding]:
    variances = np.diagonal(record.covariance, axis1=1, axis2=2)
    zero = record.completed
    negative = (variances < 0.0).any(axis=1) | ~np.isfinite(variances).all(axis=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        factor = np.sqrt(np.abs(variances) / R.diagonal())
    absurd = ((factor > _ABSURD) | (factor < 1.0 / _ABSURD)).any(axis=1) & ~zero & ~negative
    invalid = zero | negative | absurd
    if not invalid.any():
        return
    covariance = np.where(invalid[:, None, None], R, record.covariance)
    completed = np.zeros_like(zero)
    mended = evidence.with_sensor(
        name, replace(record, covariance=covariance, completed=completed)
    )
    change = {f'{name}.covariance_from': 'configuration'}
    kinds = (
        ('covariance zero', zero, 'is zero, which by convention means unknown'),
        ('covariance negative', negative, 'has a negative or infinite variance'),
        ('covariance absurd', absurd, f'differs from {name}.noise by a factor above {_ABSURD:g}'),
    )
    for kind, mask, flaw in kinds:
        if mask.any():
            yield Finding(
                kind, name,
                f'the covariance in {mask.sum()} of {len(record)} messages of {name} {flaw}. Take '
                f'it from the configuration, {name}.noise, until its driver fills it in.',
                inf, change, mended=lambda: mended, note=mask is zero,
            )  # fmt: skip
