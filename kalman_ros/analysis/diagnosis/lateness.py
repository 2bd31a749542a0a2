# SPDX-License-Identifier: Apache-2.0
"""Delay and jitter of the receipt of readings, and stamps that are late or early."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.estimators.outcome import Outcome

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .stamps import latency, picture, slope

#: Delays and jitter below this duration (s) are harmless.
_HARMLESS = 0.02


def find(case: Examination) -> list[Finding]:
    """Return the delay and jitter of each sensor from its stamp to the recorder."""
    findings = []
    for name, record in case.evidence.sensors.items():
        if len(record) > 2:
            findings += [*_delay_findings(case.evidence, name, record)]
    return findings


def _delay_findings(evidence: Evidence, name: str, record: SensorRecord) -> Iterator[Finding]:
    late = latency(record)
    late = late[late != 0.0]
    if not len(late):
        return
    low, middle, high = np.quantile(late, (0.1, 0.5, 0.9))
    window = float(evidence.parameters.get('window', 1.0))
    old = int((record.outcome == Outcome.TOO_OLD.name).sum())
    note = f'; {old} were dropped as older than the window of {window:g} s' if old else ''
    sufficient = round(float(1.2 * late.max()) + 0.05, 2)
    change = {'window': sufficient} if sufficient > window else {}
    if high - low > max(_HARMLESS, 0.5 * middle):
        yield Finding(
            'jitter', name,
            f'readings of {name} are received {late.min():.3g} to {late.max():.3g} s after their '
            f'stamp, half of them before {middle:.3g} s{note}.',
            inf, change, figure=picture(name, record, 'latency'),
        )  # fmt: skip
    elif low > _HARMLESS:
        yield Finding(
            'delay', name,
            f'readings of {name} are received {middle:.3g} s after their stamp{note}. Their '
            'stamps are right: with a window that is longer than that, none is lost.',
            inf, change, figure=picture(name, record, 'latency'),
        )  # fmt: skip


def hidden(case: Examination) -> list[Finding]:
    """Return the sensors whose readings are older or newer than their stamps.

    The reading h(x(t + tau)) is h(x) + tau d h(x)/dt to first order. A regression estimates tau.
    """
    findings = []
    for name, record in case.evidence.sensors.items():
        for column in case.responses.columns('stamp', name):
            fit = case.responses.alone(column)
            tau = float(fit.size[0])
            if fit.gain < CHANCE or not 0.002 < abs(tau) < 1.0:
                continue
            option = f'{name}.stamp_offset'
            rate = slope(record.received, latency(record))
            if abs(rate) > 1e-3:
                continue
            findings.append(
                Finding(
                    'stamps late' if tau < 0.0 else 'stamps early',
                    name,
                    f'readings of {name} fit the state {abs(tau):.3g} +- {fit.std[0]:.1g} s '
                    f'{"before" if tau < 0.0 else "after"} their stamps: they are stamped '
                    f'{"on receipt, not when they are taken" if tau < 0 else "too early"}. Stamp '
                    'them when they are taken, or set the offset.',
                    fit.gain**0.5,
                    {option: round(float(case.evidence.parameters.get(option, 0.0)) + tau, 4)},
                    gain=fit.gain,
                    figure=picture(name, record, 'latency'),
                    mended=partial(_shift_stamps, case.evidence, name, tau),
                )
            )
    return findings


def _shift_stamps(evidence: Evidence, name: str, tau: float) -> Evidence:
    """Return the evidence with the stamps of a sensor increased by ``tau`` seconds."""
    record = evidence.sensors[name]
    return evidence.with_sensor(name, replace(record, stamp=record.stamp + tau))
