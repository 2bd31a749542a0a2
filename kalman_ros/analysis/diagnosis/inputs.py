# SPDX-License-Identifier: Apache-2.0
"""Inputs that act otherwise than believed: gain, sign, delay, dead zone, disturbances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from kalman_ros.core import Array

from .bias import courses_of
from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding
from .hypotheses import edges, held
from .responses import Fit

#: Gains within this of 1 are no finding; those this far below 1 are of the wrong sign.
_RELEVANT, _REVERSED = 0.05, -1.3
#: Of the zone that fits best, the part that fits: more than all of it is no dead zone.
_DEAD = (0.3, 1.5)


def find(case: Examination) -> list[Finding]:
    """Return what is wrong with the inputs."""
    found = []
    for index, name in enumerate(case.evidence.scenario.model.input.names):
        if case.responses.columns('gain', name):
            found += _late(case, name, index)
    return [*_gains(case), *found, *_dead(case), *_disturbed(case), *_tones(case)]


def _with(evidence: Evidence, index: int, column: Array) -> Evidence:
    """Return the evidence with other values (N,) of an input."""
    value = evidence.inputs.value.copy()
    value[:, index] = column
    return replace(evidence, inputs=replace(evidence.inputs, value=value))


def _gains(case: Examination) -> list[Finding]:
    """Return the inputs that act with another sign, and those at a part of their command."""
    evidence, names = case.evidence, case.evidence.scenario.model.input.names
    fits: dict[str, dict[int, Fit]] = {'input sign': {}, 'input gain': {}}
    for index, name in enumerate(names):
        for column in case.responses.columns('gain', name):
            fit = case.responses.alone(column)
            if fit.gain >= CHANCE and abs(fit.size[0]) >= _RELEVANT:
                fits['input sign' if fit.size[0] < _REVERSED else 'input gain'][index] = fit
    return [_gain(evidence, kind, those) for kind, those in fits.items() if those]


def _gain(evidence: Evidence, kind: str, fits: Mapping[int, Fit]) -> Finding:
    """Return the finding of the inputs with these fits, by index."""
    names = evidence.scenario.model.input.names
    value, words, total = evidence.inputs.value.copy(), [], 0.0
    for index, fit in fits.items():
        gain, total = 1.0 + float(fit.size[0]), total + fit.gain
        value[:, index] *= gain
        how = f'at {gain:.3g} +- {fit.std[0]:.1g} of its command'
        words.append(f'{names[index]} {"with the wrong sign" if kind == "input sign" else how}')
    mended = replace(evidence, inputs=replace(evidence.inputs, value=value))
    return Finding(
        kind,
        names[min(fits)],
        f'the input does not act as commanded: {", ".join(words)}.',
        total**0.5,
        gain=total,
        mended=lambda: mended,
    )


def _late(case: Examination, name: str, index: int) -> list[Finding]:
    """Return a delay: the lag at which what acts is what was commanded, or lost commands.

    A command that is lost with the probability p leaves the one before in effect, on average
    the mixture (1 - p) u_k + p u_{k-1}: a lag of one sample with the weight p.
    """
    labels = case.responses.columns('lag', name)
    fits = {int(case.responses.labels[c][2]): case.responses.alone(c) for c in labels}
    lag, fit = max(fits.items(), key=lambda item: item[1].gain)
    weight = float(fit.size[0])
    if fit.gain < CHANCE or weight <= 0.0:
        return []
    evidence, dt = case.evidence, 1.0 / case.evidence.scenario.rate
    stamps, u = evidence.inputs.stamp, evidence.inputs.value[:, index]
    before = held(stamps, u, stamps - lag * dt + 2e-6)
    late = weight * lag * dt
    return [
        Finding(
            'input delay',
            name,
            f'the input {name} acts {late:.3g} s after its command on average: a delay of the '
            f'actuator, or commands that are lost while the one before stays in effect.',
            fit.gain**0.5,
            gain=fit.gain,
            mended=lambda: _with(evidence, index, u + min(weight, 1.0) * (before - u)),
        )
    ]


def _dead(case: Examination) -> list[Finding]:
    """Return the inputs of which a part about zero has no effect."""
    evidence = case.evidence
    value, words, first, gain = evidence.inputs.value.copy(), [], '', 0.0
    for index, name in enumerate(evidence.scenario.model.input.names):
        columns = case.responses.columns('dead', name)
        fits = [case.responses.alone(column) for column in columns]
        best = max(range(len(fits)), key=lambda i: fits[i].gain, default=None)
        if best is None or fits[best].gain < CHANCE:
            continue
        if not _DEAD[0] < fits[best].size[0] < _DEAD[1]:
            continue
        zone = float(fits[best].size[0]) * float(case.responses.labels[columns[best]][2])
        value[:, index] -= np.clip(value[:, index], -zone, zone)
        gain, first = gain + fits[best].gain, first or name
        words.append(f'{zone:.3g} of {name}')
    if not words:
        return []
    mended = replace(evidence, inputs=replace(evidence.inputs, value=value))
    return [
        Finding(
            'dead zone',
            first,
            f'the first {", ".join(words)}, either way, has no effect: a dead zone, as of a motor '
            'with static friction.',
            gain**0.5,
            gain=gain,
            mended=lambda: mended,
        )
    ]


def _disturbed(case: Examination) -> list[Finding]:
    """Return what adds to the inputs: a constant, or what grows or wanders."""
    evidence, limits = case.evidence, edges(case.passage)
    names = evidence.scenario.model.input.names
    groups = {i: case.responses.columns('push', name) for i, name in enumerate(names)}
    courses = courses_of(case.responses, groups)
    if not courses:
        return []
    pieces = np.searchsorted(limits, evidence.inputs.stamp, 'right') - 1
    value, words = evidence.inputs.value.copy(), []
    for index, course in courses.items():
        value[:, index] += course.values[np.clip(pieces, 0, len(course.values) - 1)]
        low, high = course.values.min(), course.values.max()
        size = f'{low:+.3g}' if course.kind == 'constant' else f'{low:+.3g} to {high:+.3g}'
        words.append(f'{size} to {names[index]}')
    mended = replace(evidence, inputs=replace(evidence.inputs, value=value))
    gain = sum(course.gain for course in courses.values())
    middles = 0.5 * (limits[1:] + limits[:-1]) - limits[0]
    curves = tuple(Curve(names[i], middles, course.values) for i, course in courses.items())
    return [
        Finding(
            'disturbance',
            names[next(iter(courses))],
            f'something adds {", ".join(words)}: a slope, wind, a bias of the actuator, or an '
            'input that the model does not have.',
            gain**0.5,
            gain=gain,
            figure=Figure('What adds to the input', 'time [s]', 'input', curves),
            mended=lambda: mended,
        )
    ]


def _tones(case: Examination) -> list[Finding]:
    """Return sines that add to the inputs."""
    evidence = case.evidence
    stamps, value = evidence.inputs.stamp, evidence.inputs.value.copy()
    gain, words, first = 0.0, [], ''
    for index, name in enumerate(evidence.scenario.model.input.names):
        columns = case.responses.columns('tone', name)
        fit = case.responses.fit(np.eye(2), columns) if columns else None
        if fit is None or fit.gain < CHANCE + 20.0:
            continue
        frequency = float(case.responses.labels[columns[0]][2])
        turn = 2.0 * np.pi * frequency * (stamps + 0.5 / evidence.scenario.rate)
        value[:, index] += fit.size[0] * np.sin(turn) + fit.size[1] * np.cos(turn)
        gain, first = gain + fit.gain, first or name
        words.append(f'{np.hypot(*fit.size):.3g} at {frequency:.3g} Hz to {name}')
    mended = replace(evidence, inputs=replace(evidence.inputs, value=value))
    return (
        [
            Finding(
                'disturbance',
                first,
                f'a sine adds {", ".join(words)}: a vibration, or an input that the '
                'model does not have.',
                gain**0.5,
                gain=gain,
                mended=lambda: mended,
            )
        ]
        if words
        else []
    )
