# SPDX-License-Identifier: Apache-2.0
"""Rate of readings: losses, bursts of losses, and readings that are not finite."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.analysis.records import SensorRecord, period
from kalman_ros.core import Array
from kalman_ros.estimators.outcome import Outcome

from .examination import Examination
from .finding import Curve, Figure, Finding

#: Smallest share of losses, and smallest relative difference of rates, that is a finding.
_LOST, _DIFFERENT = 0.01, 0.1
#: More missing readings in a row are a burst; a source of which more than this share is missing,
#: and in bursts, reads now and then.
_BURST, _SELDOM = 3, 0.5
#: Number of sensors of one kind that are those of beacons or landmarks.
_BEACONS = 3
#: Fewest values that are published several times, least times, and how much these may differ.
_VALUES, _TIMES, _ALIKE = 20, 2, 1.5


def find(case: Examination) -> list[Finding]:
    """Return the faults in the rate of each sensor, and readings that are not finite."""
    findings, sources = [], case.evidence.scenario.sensors
    all_gaps = {name: _gaps(record) for name, record in case.evidence.sensors.items()}
    kinds: dict[tuple[str, ...], list[bool]] = {}
    for name, gaps in all_gaps.items():
        units = tuple(sources[name].sensor.output.units)
        kinds.setdefault(units, []).append(gaps is not None and gaps.seldom)
    for name, record in case.evidence.sensors.items():
        rate = case.evidence.scenario.sensors[name].timed.rate
        if not len(record):
            if name in case.evidence.scenario.enabled:
                sentence = f'no reading of {name} was received.'
                findings.append(Finding('no readings', name, sentence, inf, silent=True))
            continue
        findings += _find_invalid(name, record)
        is_declared = f'{name}.rate' in case.evidence.parameters
        gaps = all_gaps[name]
        if gaps is not None:
            # beacons or landmarks are all read now and then if one of them is
            alike = kinds[tuple(sources[name].sensor.output.units)]
            seldom = gaps.seldom or (len(alike) >= _BEACONS and any(alike))
            findings += _find_losses(name, gaps, rate, is_declared=is_declared, seldom=seldom)
        findings += _find_repeated(name, record)
    return findings


def _find_repeated(name: str, record: SensorRecord) -> Iterator[Finding]:
    """Yield a note if each value is published a number of times, which is the same for all."""
    lengths = np.diff(np.flatnonzero(np.append(~record.unchanged, True)))[1:-1]
    if len(lengths) < _VALUES:
        return
    low, middle, high = np.quantile(lengths, (0.1, 0.5, 0.9))
    if low >= _TIMES and high <= _ALIKE * middle:
        yield Finding(
            'repeated', name,
            f'each value of {name} is published about {middle:g} times: '
            f'{100.0 * record.unchanged[1:].mean():.2g} % of its readings repeat the one before, '
            'and the filter takes each for news. Publish what is measured, once.',
            inf, note=True,
        )  # fmt: skip


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


class _Gaps(NamedTuple):
    """Stamps of readings, the gap between them, how many are missing in each, and the share.

    It is that of a source that is read now and then if ``seldom``.
    """

    stamps: Array
    gap: float
    missing: Any
    share: float
    seldom: bool


def _gaps(record: SensorRecord) -> _Gaps | None:
    """Return the gaps between readings; None of less than six."""
    stamps = np.unique(np.round(record.stamp[record.stamped], 6))
    gaps = np.diff(stamps)
    if len(gaps) < 5:
        return None
    gap = period(gaps)
    missing = np.round(gaps / gap).astype(int) - 1
    # intervals that jitter are short or long, and nothing is lost
    schedule = [
        round(np.ptp(stamps) / interval) - len(gaps) for interval in (gap, np.median(gaps))
    ]
    lost = min(int(missing[missing > 0].sum()), *schedule)
    share = lost / (lost + len(stamps))
    return _Gaps(stamps, gap, missing, share, bool(share > _SELDOM and missing.max() > _BURST))


def _find_losses(
    name: str, statistics: _Gaps, declared: float, *, is_declared: bool, seldom: bool
) -> Iterator[Finding]:
    stamps, gap, missing, share, _ = statistics
    gaps = np.diff(stamps)
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
