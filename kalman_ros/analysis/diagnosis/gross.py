# SPDX-License-Identifier: Apache-2.0
"""Readings that are so wrong that a filter is lost, and no linearisation along its path holds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import pi

import numpy as np

from .examination import CHANCE, Examination
from .finding import Finding
from .mounting import exchanged
from .passage import explained, passage
from .units import conversions, scaled

#: A filter is lost if its innovations squared are larger than expected by this factor.
_LOST = 2.0
#: Candidates are compared on the first seconds.
_SECONDS = 8.0
#: Factors that are tried on each coordinate.
_FACTORS = (-1.0, pi / 180.0, 180.0 / pi, 1.0 / 3.6, 1e-3)


def find(case: Examination) -> list[Finding]:
    """Return units, signs and exchanges of axes that bring a lost filter back, by passes.

    Each candidate is passed itself, on the first seconds; of a linear system the regressions have
    the same at once.
    """
    if not lost(case):
        return []
    until = case.passage.events[0].time + _SECONDS
    before = passage(case.evidence, until, strict=False)
    part = len(case.passage.events) / len(before.events)
    found = []
    for finding in _candidates(case):
        if finding.mended is None:
            continue
        try:
            gain = explained(before, passage(finding.mended(), until)) * part - finding.dues
        except np.linalg.LinAlgError:
            continue
        if gain > CHANCE:
            found.append(replace(finding, gain=gain, z=gain**0.5))
    return sorted(found, key=lambda finding: -finding.gain)[:2]


def lost(case: Examination) -> bool:
    """Return whether the filter is so far off that its linearisation holds nowhere."""
    squares = np.array([e @ e / len(e) for e in case.passage.whitened])
    return not case.evidence.scenario.plan.linear and bool(squares.mean() >= _LOST)


def _candidates(case: Examination) -> Iterator[Finding]:
    for name in dict.fromkeys(event.sensor for event in case.passage.events):
        size = case.evidence.scenario.sensors[name].sensor.output.size
        for index in range(size):
            sensible = conversions(case, name, (index,))
            for factor in _FACTORS:
                if factor > 0.0 and factor not in sensible:
                    continue
                yield scaled(case, name, (index,), factor, 0.0, 0.0)
        if size == 2:
            yield exchanged(case, name, (1, 0), 0.0)
