# SPDX-License-Identifier: Apache-2.0
"""Delay and jitter of the receipt of readings, and stamps that are late or early."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.scenario.signal_declarations import LONGEST_OFFSET

from .evidence import Evidence
from .examination import CHANCE, Examination
from .filter_pass import passage
from .finding import Finding
from .hypotheses import walks
from .passage import Passage, explained_in_both
from .peak import deviation, peak
from .responses import Fit
from .stamps import latency, picture, slope

#: Delays and jitter below this duration (s) are harmless.
_HARMLESS = 0.02
#: Stamps are wrong by more than the first time (s), and by less than the second or a share of the
#: recording.
_EARLIEST, _LATEST, _SHARE = 0.002, 1.0, 0.1
#: Fewest readings of which the times are tried, the least time, and what it has to explain.
_FEWEST, _STEP, _PROMISING = 20, (0.01, 0.05), 10.0
#: Number of readings on which times are tried.
_PART = 3000
#: Mean square of innovations from which times beyond the second number (s) are tried, and the
#: ratio of one to the next.
MISFIT, _NEAR, _FARTHER = 1.2, 0.2, 3.0


def find(case: Examination) -> list[Finding]:
    """Return the delay and jitter of each sensor from its stamp to the recorder.

    Where no reading was lost by it, it is a note.
    """
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
    sufficient = round(float(1.2 * late.max()) + 0.05, 2)
    change = {'window': sufficient} if sufficient > window else {}
    note = ''
    if old:
        note = f'; {old} were dropped as older than the window of {window:g} s'
    elif change:
        note = f'; the window of {window:g} s is just long enough'
    if high - low > max(_HARMLESS, 0.5 * middle):
        yield Finding(
            'jitter', name,
            f'readings of {name} are received {late.min():.3g} to {late.max():.3g} s after their '
            f'stamp, half of them before {middle:.3g} s{note}.',
            inf, change, figure=picture(name, record, 'latency'), note=not old,
        )  # fmt: skip
    elif low > _HARMLESS:
        yield Finding(
            'delay', name,
            f'readings of {name} are received {middle:.3g} s after their stamp{note}. Their '
            'stamps are right: with a window that is longer than that, none is lost.',
            inf, change, figure=picture(name, record, 'latency'), note=not old,
        )  # fmt: skip


def hidden(case: Examination) -> list[Finding]:
    """Return the sensors whose readings are older or newer than their stamps.

    The reading h(x(t + tau)) is h(x) + tau d h(x)/dt to first order. A regression estimates tau.
    """
    findings = []
    for name in case.judged:
        record = case.evidence.sensors[name]
        for column in case.responses.columns('stamp', name):
            fit = case.responses.alone(column)
            most = max(_LATEST, _SHARE * case.evidence.duration)
            if fit.gain < CHANCE or not _EARLIEST < abs(float(fit.size[0])) < most:
                continue
            rate = slope(record.received, latency(record))
            if abs(rate) > 1e-3:
                continue
            findings.append(stamped(case.evidence, name, 0.0, fit))
    return [*findings, *_by_passes(case)]


def _by_passes(case: Examination) -> Iterator[Finding]:
    """Yield the sensors that fit another time better, by passes of the filter.

    They are those of which the regression knows nothing, since the model has no rate of the state
    that they read: it walks at random. In a filter that does not fit they are all, since a long
    time is beyond the regression.
    """
    far = case.passage.mean_square > MISFIT
    for name in case.judged:
        fit, count = case.responses.first('stamp', name), len(case.passage.of(name))
        least = min(max(case.evidence.duration / max(count, 1), _STEP[0]), _STEP[1])
        if fit is None or count < _FEWEST:
            continue
        known = 0.0 < fit.std[0] <= least and not walks(case.evidence, case.passage, name)
        if known and not far:
            continue
        search = TimeSearch(case, partial(shift_stamps, case.evidence, name), explained_in_both)
        likeliest = search.likeliest(least, far)
        if likeliest is not None:
            yield stamped(case.evidence, name, 0.0, likeliest)


class TimeSearch:
    """The search of a time by which stamps are wrong, in a part of a recording that shows it.

    Parameters
    ----------
    case
        Recording.
    shift
        Function that returns the recording with stamps, of a sensor or of the input, that are
        later by a time in s.
    compare
        Function that returns the gain of a pass with other times, the second one, over the first.
    """

    def __init__(
        self,
        case: Examination,
        shift: Callable[[float], Evidence],
        compare: Callable[[Passage, Passage], float],
    ) -> None:
        self._shift, self._compare = shift, compare
        self._longest = max(_LATEST, _SHARE * case.evidence.duration)
        count = min(len(case.passage.events), _PART)
        self._share = count / len(case.passage.events)
        self._before = case.passage.first(count)
        self._until = float(self._before.series('time')[-1])
        self._gains: dict[float, float] = {}

    def gain(self, tau: float) -> float:
        """Return how much a time explains of the whole, by the part."""
        if tau not in self._gains:
            try:
                after = passage(self._shift(tau), self._until)
                self._gains[tau] = self._compare(self._before, after) / self._share
            except np.linalg.LinAlgError:
                self._gains[tau] = -inf
        return self._gains[tau]

    def likeliest(self, least: float, far: bool = True) -> Fit | None:
        """Return the time that explains most, if any does.

        Times from ``least`` s on are tried in both directions, and if it may be ``far`` long ones.
        """
        times, longest = [least], self._longest if far else _NEAR
        while _FARTHER * times[-1] < longest:
            times.append(_FARTHER * times[-1])
        tau = max((sign * time for time in times for sign in (-1.0, 1.0)), key=self.gain)
        return self.from_time(tau) if self.gain(tau) > _PROMISING else None

    def from_time(self, tau: float) -> Fit:
        """Return the time that explains most, from one of the same sign on."""
        while abs(2.0 * tau) < self._longest and self.gain(2.0 * tau) > self.gain(tau):
            tau *= 2.0
        near = peak(self.gain, *sorted((0.5 * tau, tau, 2.0 * tau)))
        tau = near[1]
        std = min(deviation(self.gain, *near), abs(tau))
        return Fit(np.array([tau]), np.array([[std**2]]), self.gain(tau))


def stamped(evidence: Evidence, name: str, before: float, fit: Fit) -> Finding:
    """Return the finding that stamps are wrong by a fitted time beyond ``before`` seconds."""
    tau, record = before + float(fit.size[0]), evidence.sensors[name]

    def again(after: Examination) -> Finding | None:
        more = after.responses.first('stamp', name)
        if more is None or not more.remains:
            return None
        return stamped(evidence, name, tau, more)

    change = offset_by(evidence, name, tau)
    side, when = 'after', 'too early'
    if tau < 0.0:
        side, when = 'before', 'on receipt, not when they are taken'
    words = f'stamps: they are stamped {when}. Stamp them when they are taken, or set the offset.'
    if name in evidence.headerless:
        words = 'receipt. Publish a type with a header, stamped when they are taken.'
    return Finding(
        'stamps late' if tau < 0.0 else 'stamps early',
        name,
        f'readings of {name} fit the state {abs(tau):.4g} ± {fit.std[0]:.1g} s {side} their '
        + words,
        fit.gain**0.5,
        change,
        gain=fit.gain,
        figure=picture(name, record, 'latency'),
        mended=partial(shift_stamps, evidence, name, tau),
        again=again,
    )


def offset_by(evidence: Evidence, name: str, tau: float) -> dict[str, float]:
    """Return the parameter that adds a time to the stamps of a sensor or of the input, if any."""
    option = f'{name}.stamp_offset'
    offset = round(float(evidence.parameters.get(option, 0.0)) + tau, 4)
    possible = name not in evidence.headerless and abs(offset) <= LONGEST_OFFSET
    return {option: offset} if possible else {}


def shift_stamps(evidence: Evidence, name: str, tau: float) -> Evidence:
    """Return the evidence with the stamps of a sensor increased by ``tau`` seconds."""
    record = evidence.sensors[name]
    return evidence.with_sensor(name, replace(record, stamp=record.stamp + tau))
