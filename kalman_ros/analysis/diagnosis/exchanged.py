# SPDX-License-Identifier: Apache-2.0
"""Two sensors whose readings are exchanged: left and right wheels, or two beacons."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np

from .evidence import Evidence
from .examination import CHANCE, Examination
from .filter_pass import passage
from .finding import Finding
from .noise_levels import innovations
from .passage import explained

#: The largest number of pairs that are tried, of those whose readings fit worst.
_PAIRS = 3
#: Readings fit badly if their squared innovations exceed their expectation by this factor.
_BAD = 2.0


def find(case: Examination) -> list[Finding]:
    """Return the pairs of which each one's readings fit the predictions of the other.

    The predictions of a slow process are misled by its readings, so that the pairs whose readings
    fit worst are tried. (Those of a lost filter are among its candidates.)
    """
    findings, linear = [], case.evidence.scenario.plan.linear
    for number, (one, other) in enumerate(_worst(case)):
        gain = _gain_of(case, one, other) + _gain_of(case, other, one)
        bad = any(_is_bad(case, name) for name in (one, other))
        if gain <= CHANCE and bad and linear and number < _PAIRS:
            gain = explained(case.passage, passage(_swapped(case, one, other), strict=False))
        if gain > CHANCE:
            findings.append(exchanged(case, one, other, gain))
    return sorted(findings, key=lambda finding: -finding.gain)[:_PAIRS]


def candidates(case: Examination) -> Iterator[Finding]:
    """Yield the pairs that fit worst, for a lost filter, whose predictions mean nothing."""
    for one, other in _worst(case)[:_PAIRS]:
        yield exchanged(case, one, other, 0.0)


def _worst(case: Examination) -> list[tuple[str, str]]:
    """Return the pairs of sensors that read the same unit, those that fit worst first."""
    squares = {name: float(case.passage.squares(name).mean()) for name in case.judged}
    return sorted(_alike(case), key=lambda pair: -min(squares[name] for name in pair))


def _alike(case: Examination) -> Iterator[tuple[str, str]]:
    """Yield the pairs of sensors whose readings have the same units."""
    sources = case.evidence.scenario.sensors
    for one, other in combinations(case.judged, 2):
        if sources[one].sensor.output.units == sources[other].sensor.output.units:
            yield one, other


def _gain_of(case: Examination, name: str, other: str) -> float:
    """Return the reduction of the misfit if readings of a sensor are those of another one."""
    sensor = case.evidence.scenario.sensors[other].sensor
    index, X, white = (case.passage.series(field, name) for field in ('index', 'x', 'white'))
    nu = sensor.output.subtract(case.evidence.sensors[name].value[index], sensor.measure(X))
    after = np.sum(np.einsum('eij,ej->ei', white, nu) ** 2)
    return float(case.passage.squares(name).sum() - after)


def _is_bad(case: Examination, name: str) -> bool:
    """Return whether the readings of a sensor fit much worse than they are declared to."""
    squares = case.passage.squares(name)
    size = case.evidence.scenario.sensors[name].sensor.output.size
    return bool(squares.mean() > _BAD * size)


def _swapped(case: Examination, one: str, other: str) -> Evidence:
    """Return the evidence with the readings of two sensors exchanged."""
    swapped = case.evidence.with_sensor(one, case.evidence.sensors[other])
    return swapped.with_sensor(other, case.evidence.sensors[one])


def exchanged(case: Examination, one: str, other: str, gain: float) -> Finding:
    """Return the finding that two sensors are exchanged."""
    sources = case.evidence.scenario.sensors
    topics = {name: sources[name].signal.topic for name in (one, other)}
    change: dict[str, Any] = {}
    if topics[one] != topics[other]:
        change = {f'{one}.topic': topics[other], f'{other}.topic': topics[one]}
    swapped = _swapped(case, one, other)
    return Finding(
        'swapped', one,
        f'readings of {one} and {other} are exchanged: each fit what is expected of the other. '
        'Exchange their topics, cables or addresses.',
        gain**0.5, change, gain=gain, figure=innovations(case, one, 0), mended=lambda: swapped,
    )  # fmt: skip
