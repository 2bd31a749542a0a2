# SPDX-License-Identifier: Apache-2.0
"""Readings that are so wrong that a filter is lost, and no linearisation along its path holds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import takewhile
from math import pi

import numpy as np

from .examination import CHANCE, Examination
from .finding import Finding
from .left_out import left_out
from .mounting import best_rotation, exchanged, nearest_rotation, turned, vectors, within
from .passage import Passage, explained, passage
from .units import conversions, groups, mixed, scaled

#: A filter is lost if its innovations squared are larger than expected by this factor.
_LOST = 2.0
#: Candidates are compared on the first seconds; those that make it worse are dropped sooner.
_SECONDS, _SOONER = 8.0, 2.0
#: Rotations are found in the first seconds; smaller ones (rad) make no filter lost.
_TURNED_SECONDS, _TURNED = 20.0, 0.2
#: Factors that are tried on each coordinate.
_FACTORS = (-1.0, pi / 180.0, 180.0 / pi, 1.0 / 3.6, 1e-3)


def find(case: Examination) -> list[Finding]:
    """Return units, signs, exchanges and turns of axes that bring a lost filter back, by passes.

    Each candidate is passed itself, on the first seconds; of a linear system the regressions have
    the same at once.
    """
    if not lost(case):
        return []
    begin = case.passage.events[0].time
    sooner, compared = (_Span(case, begin + seconds) for seconds in (_SOONER, _SECONDS))
    part = len(case.passage.events) / len(compared)
    found = []
    for finding in _candidates(case):
        try:
            if sooner.gain(finding) < -CHANCE:
                continue
            gain = part * compared.gain(finding) - finding.dues
        except np.linalg.LinAlgError:
            continue
        if gain > CHANCE:
            found.append(replace(finding, gain=gain, z=gain**0.5))
    return sorted(found, key=lambda finding: -finding.gain)[:2]


class _Span:
    """The first seconds of a recording, up to a stamp, on which candidates are passed."""

    def __init__(self, case: Examination, until: float) -> None:
        self._until = until
        whole = case.passage
        events = list(takewhile(lambda event: event.time <= until, whole.events))
        self._before = Passage(events, whole.whitened[: len(events)])

    def __len__(self) -> int:
        return len(self._before.events)

    def gain(self, finding: Finding) -> float:
        """Return what a finding explains of this span.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the filter fails with it.
        """
        assert finding.mended is not None
        return explained(self._before, passage(finding.mended(), self._until))


def lost(case: Examination) -> bool:
    """Return whether the filter is so far off that its linearisation holds nowhere."""
    squares = np.array([e @ e / len(e) for e in case.passage.whitened])
    return not case.evidence.scenario.plan.linear and bool(squares.mean() >= _LOST)


def _candidates(case: Examination) -> Iterator[Finding]:
    for name in dict.fromkeys(event.sensor for event in case.passage.events):
        space = case.evidence.scenario.sensors[name].sensor.output
        for group in groups(space):
            sensible = conversions(case, name, group)
            for factor in _FACTORS:
                if factor > 0.0 and factor not in sensible:
                    continue
                yield scaled(case, name, group, factor, 0.0, 0.0)
        if space.size == 2:
            yield exchanged(case, name, (1, 0), 0.0)
        yield from _turned(case, name)


def _turned(case: Examination, name: str) -> Iterator[Finding]:
    """Yield the rotation of each vector reading by which it fits what the others predict.

    From there the filter is no longer lost, and the regressions hold.
    """
    space = case.evidence.scenario.sensors[name].sensor.output
    axes = vectors(space)
    until = case.passage.events[0].time + _TURNED_SECONDS
    others = left_out(case, name, until) if axes else None
    if others is None:
        return
    for group in axes:
        y, expected = others.record.value[:, group], others.predicted[:, group]
        turn = nearest_rotation(expected.T @ y)
        if np.linalg.norm(turn - np.eye(len(turn))) < _TURNED:
            continue
        near = mixed(case.evidence, name, within(case, name, group, turn))
        first = passage(near, until, strict=False)
        turn = best_rotation(Examination(near, strict=False, known=first), name, group) @ turn
        rms = float(np.sqrt(np.mean(np.sum((y @ turn.T - expected) ** 2, axis=1))))
        left = f'Then {rms:.3g} {space.units[group[0]]} rms are left to what the others predict.'
        yield turned(case, name, group, turn, 0.0, left)
