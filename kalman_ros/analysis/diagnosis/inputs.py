# SPDX-License-Identifier: Apache-2.0
"""Faults of inputs: gain, delay, dead zone, and disturbances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array

from . import input_gains
from .bias import SUREST, Course, courses_of
from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding
from .hypotheses import edges, held
from .lateness import MISFIT, TimeSearch, offset_by
from .passage import explained_in_both
from .tested import likelier

#: Two gains that differ by less than this are no finding.
_RELEVANT = 0.05
#: Range of the fitted share of a zone: outside of it the zone is another one, or none.
_DEAD_SHARE = (0.3, 1.5)
#: Least share of the inputs that enter or cross a dead zone; otherwise it is a constant offset.
_MOVING = 0.05
#: Shortest time (s) by which an input is stamped late that passes look for.
_SOONEST = 0.01
#: Most periods of a sine in an interval between two inputs, by which it is corrected.
_FOLLOWED = 0.25


def find(case: Examination) -> list[Finding]:
    """Return the faults of the inputs."""
    return [
        *input_gains.find(case),
        *_find_asymmetries(case),
        *_find_delays(case),
        *_find_late(case),
        *_find_dead_zones(case),
        *_find_disturbances(case),
        *_find_tones(case),
    ]


def _with_input(evidence: Evidence, index: int, column: Array) -> Evidence:
    """Return the evidence with other values (N,) of an input."""
    value = evidence.inputs.value.copy()
    value[:, index] = column
    return evidence.with_inputs(value)


class _Part(NamedTuple):
    """The addition of a fault to an input (N,), with its gain and its words."""

    input: int
    change: Array
    gain: float
    words: str
    dues: float = 0.0


@dataclass
class _Joint:
    """A fault of several inputs together, or of one of them."""

    kind: str
    sentence: str
    evidence: Evidence
    parts: list[_Part] = field(default_factory=list)

    def finding(self, parts: Sequence[_Part], gain: float, **more: Any) -> Finding:
        """Return the finding of some inputs."""
        value = self.evidence.inputs.value.copy()
        for part in parts:
            value[:, part.input] += part.change
        return Finding(
            self.kind, self.evidence.scenario.model.input.names[parts[0].input],
            self.sentence.format(', '.join(part.words for part in parts)), gain**0.5, gain=gain,
            parameters=len(parts), dues=sum(part.dues for part in parts),
            most=SUREST if any(part.dues for part in parts) else 1.0,
            mended=lambda: self.evidence.with_inputs(value), **more,
        )  # fmt: skip

    def findings(self, together: Sequence[_Part] = (), **more: Any) -> list[Finding]:
        """Return the finding of all inputs ``together``, and those of each input alone.

        Inputs that act alike each explain the whole, and their gains do not add up.
        """
        groups = [together or self.parts, *([part] for part in self.parts if len(self.parts) > 1)]
        return [
            self.finding(group, sum(part.gain for part in group), **more)
            for group in groups
            if group
        ]


def _find_asymmetries(case: Examination) -> list[Finding]:
    """Return the inputs that act with another gain in one direction."""
    findings = []
    for index, name in enumerate(case.evidence.scenario.model.input.names):
        columns = [case.responses.columns(kind, name) for kind in ('gain', 'half')]
        if not all(columns):
            continue
        fit = case.responses.fit(np.eye(2), [column for (column,) in columns])
        gains = 1.0 + float(fit.size.sum()), 1.0 + float(fit.size[0])
        if fit.gain >= CHANCE and abs(gains[0] - gains[1]) >= _RELEVANT:
            findings.append(_asymmetric(case.evidence, index, gains, fit.gain))
    return findings


def _asymmetric(
    evidence: Evidence, index: int, gains: tuple[float, float], gain: float
) -> Finding:
    """Return the finding of an input with these gains where it is positive, and negative."""
    name, u = evidence.scenario.model.input.names[index], evidence.inputs.value[:, index]
    return Finding(
        'asymmetric gain', name,
        f'the input {name} acts at {gains[0]:.3g} of its command where that is positive, and at '
        f'{gains[1]:.3g} where it is negative.',
        gain**0.5, gain=gain, parameters=2,
        mended=lambda: _with_input(evidence, index, np.where(u > 0.0, *gains) * u),
    )  # fmt: skip


def _find_delays(case: Examination) -> list[Finding]:
    """Return the delay of each input, from the lag of its effect or from lost commands.

    A command that is lost with the probability p leaves the previous command in effect. The
    average is (1 - p) u_k + p u_{k-1}, a lag of one sample with the weight p.
    """
    findings = []
    for index, name in enumerate(case.evidence.scenario.model.input.names):
        estimate = _delay(case, name)
        if estimate is None or estimate.gain < CHANCE or estimate.weight <= 0.0:
            continue
        delay, column = estimate.seconds, case.evidence.inputs.value[:, index]
        lost = column + min(estimate.weight, 1.0) * (_later(case, index, estimate.lag) - column)
        finding = Finding(
            'input delay', name,
            f'the input {name} acts {delay:.3g} s after its command on average: a delay of the '
            'actuator, or commands that are lost while the one before stays in effect.',
            estimate.gain**0.5, gain=estimate.gain,
            mended=partial(_with_input, case.evidence, index, lost),
        )  # fmt: skip
        pure = partial(_with_input, case.evidence, index, _later(case, index, delay))
        both = finding, replace(finding, mended=pure)
        findings.append(replace(finding, exact=partial(likelier, case, *both)))
    return findings


class _Delay(NamedTuple):
    """A trial lag in s with its fitted weight, the standard deviation of that, and its gain."""

    lag: float
    weight: float
    std: float
    gain: float

    @property
    def seconds(self) -> float:
        """The delay in s."""
        return self.weight * self.lag


def _delay(case: Examination, *name: str) -> _Delay | None:
    """Return the likeliest delay of an input, or without a name of all of them together."""
    lags: dict[str, list[int]] = {}
    for column in case.responses.columns('lag', *name):
        lags.setdefault(case.responses.labels[column][2], []).append(column)
    fits = {
        lag: case.responses.fit(np.ones((len(columns), 1)), columns)
        for lag, columns in lags.items()
    }
    if not fits:
        return None
    lag, fit = max(fits.items(), key=lambda item: item[1].gain)
    seconds = int(lag) / case.evidence.scenario.rate
    return _Delay(seconds, float(fit.size[0]), float(fit.std[0]), fit.gain)


def _later(case: Examination, index: int, seconds: float) -> Array:
    """Return the values (N,) of an input that acts ``seconds`` late."""
    stamps, values = case.evidence.inputs.stamp, case.evidence.inputs.value[:, index]
    return held(stamps, values, stamps - seconds + 2e-6)


def _find_late(case: Examination) -> Iterator[Finding]:
    """Yield the delay of all inputs, which are in one message, as a pure delay.

    If the filter does not fit, it is searched by passes, too, and may be negative.
    """
    estimate = _delay(case)
    if estimate is None:
        return
    if estimate.gain >= CHANCE and estimate.weight > 0.0:
        yield _late(case.evidence, estimate.seconds, estimate.std * estimate.lag, estimate.gain)
    if case.passage.mean_square > MISFIT:
        search = TimeSearch(case, case.evidence.with_late_inputs, explained_in_both)
        fit = search.likeliest(max(1.0 / case.evidence.scenario.rate, _SOONEST))
        if fit is not None:
            yield _late(case.evidence, float(fit.size[0]), float(fit.std[0]), fit.gain)


def _late(evidence: Evidence, seconds: float, std: float, gain: float) -> Finding:
    """Return the finding that all inputs act late, or are stamped late."""
    names = ', '.join(evidence.scenario.model.input.names)
    kind, subject, change = 'input delay', names, {}
    sentence = (
        f'the input acts {seconds:.4g} ± {std:.1g} s after its command: a delay of the actuator, '
        'or of the connection to it.'
    )
    if seconds < 0.0:
        kind, subject, change = 'stamps late', 'input', offset_by(evidence, 'input', seconds)
        sentence = (
            f'the input acts {-seconds:.4g} ± {std:.1g} s before its stamps: they are made on '
            'receipt, or by a clock that is ahead of those of the sensors.'
        )

    def again(after: Examination) -> Finding | None:
        """Return the delay with what remains of it."""
        more = _delay(after)
        return more and _late(evidence, seconds + more.seconds, more.std * more.lag, gain)

    return Finding(
        kind, subject, sentence, gain**0.5, change, gain=gain,
        mended=lambda: evidence.with_late_inputs(seconds), again=again,
    )  # fmt: skip


def _find_dead_zones(case: Examination) -> list[Finding]:
    """Return the inputs with a dead zone, in which they have no effect."""
    joint = _Joint(
        'dead zone', 'the first {}, either way, has no effect: a dead zone, as of a motor with '
        'static friction.', case.evidence,
    )  # fmt: skip
    for index, name in enumerate(case.evidence.scenario.model.input.names):
        columns = case.responses.columns('dead', name)
        fits = [(case.responses.alone(column), column) for column in columns]
        near = [pair for pair in fits if _DEAD_SHARE[0] < pair[0].size[0] < _DEAD_SHARE[1]]
        fit, column = max(near, key=lambda pair: pair[0].gain, default=(None, 0))
        if fit is None or fit.gain < CHANCE:
            continue
        zone = float(fit.size[0]) * float(case.responses.labels[column][2])
        clipped = np.clip(case.evidence.inputs.value[:, index], -zone, zone)
        if np.mean(clipped != np.median(clipped)) < _MOVING:
            continue
        joint.parts.append(_Part(index, -clipped, fit.gain, f'{zone:.3g} of {name}'))
    return joint.findings()


def _find_disturbances(case: Examination) -> list[Finding]:
    """Return the disturbances of the inputs: constant, growing, or wandering."""
    evidence, limits = case.evidence, edges(case.passage)
    names = evidence.scenario.model.input.names
    groups = {i: case.responses.columns('push', name) for i, name in enumerate(names)}
    courses = courses_of(case.responses, groups)
    pieces = np.searchsorted(limits, evidence.inputs.stamp, 'right') - 1
    joint = _Joint(
        'disturbance', 'something adds {}: a slope, wind, a bias of the actuator, or an input '
        'that the model does not have.', evidence,
    )  # fmt: skip

    def part(index: int, course: Course) -> _Part:
        low, high = course.values.min(), course.values.max()
        size = f'{low:+.3g}' if course.kind == 'constant' else f'{low:+.3g} to {high:+.3g}'
        added = course.values[np.clip(pieces, 0, len(course.values) - 1)]
        return _Part(index, added, course.gain, f'{size} to {names[index]}', course.dues)

    joint.parts += [part(*item) for item in courses.items()]
    together = [part(*item) for item in _constants(case, groups, courses).items()]
    middles = 0.5 * (limits[1:] + limits[:-1]) - limits[0]
    curves = tuple(Curve(names[i], middles, course.values) for i, course in courses.items())
    figure = Figure('What adds to the input', 'time [s]', 'input', curves)
    return joint.findings(together, figure=figure)


def _constants(
    case: Examination, groups: Mapping[int, list[int]], courses: Mapping[int, Course]
) -> dict[int, Course]:
    """Return the constant courses of several inputs, fitted together; none of another kind."""
    if len(courses) < 2 or any(course.kind != 'constant' for course in courses.values()):
        return {}
    columns = [column for index in courses for column in groups[index]]
    pieces = [len(groups[index]) for index in courses]
    fit = case.responses.fit(np.repeat(np.eye(len(courses)), pieces, axis=0), columns)
    return {
        index: replace(
            course, values=np.full_like(course.values, size), gain=fit.gain / len(courses)
        )
        for (index, course), size in zip(courses.items(), fit.size.tolist())
    }


def _find_tones(case: Examination) -> list[Finding]:
    """Return the sines that are added to the inputs."""
    stamps = case.evidence.inputs.stamp
    interval = float(np.median(np.diff(stamps))) if len(stamps) > 1 else np.inf
    joint = _Joint(
        'disturbance',
        'a sine adds {}: a vibration, or an input that the model does not have.', case.evidence,
    )  # fmt: skip
    for index, name in enumerate(case.evidence.scenario.model.input.names):
        columns = case.responses.columns('tone', name)
        fit = case.responses.fit(np.eye(2), columns) if columns else None
        if fit is None or fit.gain < CHANCE + 20.0:
            continue
        frequency = float(case.responses.labels[columns[0]][2])
        if frequency * interval > _FOLLOWED:
            continue
        phase = 2.0 * np.pi * frequency * (stamps + 0.5 / case.evidence.scenario.rate)
        added = fit.size[0] * np.sin(phase) + fit.size[1] * np.cos(phase)
        words = f'{np.hypot(*fit.size):.3g} at {frequency:.3g} Hz to {name}'
        joint.parts.append(_Part(index, added, fit.gain, words))
    return joint.findings()
