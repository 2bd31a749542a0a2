# SPDX-License-Identifier: Apache-2.0
"""Rate of readings: losses, bursts of losses, and readings that are not finite."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from kalman_ros.analysis.records import SensorRecord, period
from kalman_ros.estimators.outcome import Outcome

from .examination import Examination
from .finding import Curve, Figure, Finding

#: Smallest share of losses, and smallest relative difference of rates, that is a finding.
_LOST, _DIFFERENT = 0.01, 0.1
#: More missing readings in a row are a burst; a source of which more than this share is missing,
#: and in bursts, reads now and then.
_BURST, _SELDOM = 3, 0.5


def find(case: Examination) -> list[Finding]:
    """Return the faults in the rate of each sensor, and readings that are not finite."""
    findings = []
    for name, record in case.evidence.sensors.items():
        rate = case.evidence.scenario.sensors[name].timed.rate
        if not len(record):
            if name in case.evidence.scenario.enabled:
                sentence = f'no reading of {name} was received.'
                findings.append(Finding('no readings', name, sentence, inf, silent=True))
            continue
        findings += _find_invalid(name, record)
        is_declared = f'{name}.rate' in case.evidence.parameters
        findings += _find_losses(name, record, rate, is_declared=is_declared)
    return findings


def _find_invalid(name: str, record: SensorRecord) -> Iterator[Finding]:
    """Yield a finding if readings are not finite, since every filter omits them."""
    invalid = ~np.isfinite(record.value).all(axis=1)
    without_fix = invalid & (record.outcome == Outcome.NO_FIX.name)
    for kind, rows, reason in (
        ('no position fix', without_fix,
         'have no position fix: their status is below 0, or was left as it is by default. They'),
        ('not a number', invalid & ~without_fix,
         'are not finite: its driver has no value to report, or divides by zero. They'),
    ):  # fmt: skip
        count = int(rows.sum())
        if count:
            yield Finding(
                kind, name,
                f'{count} of {len(record)} readings of {name} '
                f'({100.0 * count / len(record):.3g} %) {reason} are dropped.',
                inf, silent=count == len(record),
            )  # fmt: skip


def _find_losses(
    name: str, record: SensorRecord, declared: float, *, is_declared: bool
) -> Iterator[Finding]:
    stamps = np.unique(np.round(record.stamp[record.stamped], 6))
    gaps = np.diff(stamps)
    if len(gaps) < 5:
        return
    gap = period(gaps)
    missing = np.round(gaps / gap).astype(int) - 1
    # intervals that jitter are short or long, and nothing is lost
    schedule = [round(np.ptp(stamps) / each) - len(gaps) for each in (gap, np.median(gaps))]
    lost = min(int(missing[missing > 0].sum()), *schedule)
    share = lost / (lost + len(stamps))
    seldom = bool(share > _SELDOM and missing.max() > _BURST)
    if abs(gap * declared - 1.0) > _DIFFERENT and not seldom:
        yield Finding(
            'rate', name,
            f'{name} is read {1.0 / gap:.4g} times a second, where {name}.rate is '
            f'{declared:g}{"" if is_declared else " by default"}.',
            inf, {f'{name}.rate': float(f'{1.0 / gap:.3g}')}, note=not is_declared,
        )  # fmt: skip
    if share < _LOST:
        return
    length = float(missing[missing > 0].mean())
    burst = length > 2.0 / (1.0 - share) and missing.max() > _BURST
    figure = Figure(
        f'{name}: time between readings', 'time [s]', 'gap [s]',
        (Curve('gap', stamps[1:] - stamps[0], gaps, 'dots'),),
    )  # fmt: skip
    remedy = 'Look at its queue and its quality of service.'
    if seldom:
        remedy = 'It seems to read something that it sees now and then.'
    elif burst:
        remedy = 'Look at its link: wireless, a full queue, or a driver that stalls.'
    yield Finding(
        'losses in bursts' if burst else 'losses', name,
        f'{100.0 * share:.2g} % of the readings of {name} are missing, {length:.2g} in a row on '
        f'average, the longest gap {gaps.max():.3g} s. {remedy}',
        inf, figure=figure, note=seldom,
    )  # fmt: skip
