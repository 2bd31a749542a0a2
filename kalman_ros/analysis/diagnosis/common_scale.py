# SPDX-License-Identifier: Apache-2.0
"""A scale, unit or bias that sensors of the same kind share, such as the ranges of all beacons.

Each sensor contradicts the others by what all have in common, so that none of them shows it alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial, reduce
from typing import Any, NamedTuple

import numpy as np

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .units import conversions, replaced, scaled, scaling, share, subject

#: A factor that differs from 1 by less than this, or this number of standard deviations, is no
#: finding.
_RELEVANT, _SHOWN = 0.003, 4.0


class _Like(NamedTuple):
    """Sensors of one kind (two or more), and their coordinates of one unit."""

    sensors: tuple[str, ...]
    group: tuple[int, ...]


def find(case: Examination) -> Iterator[Finding]:
    """Yield the sensors of one kind that fit with one factor, or without one offset."""
    for like in _alike(case):
        yield from _find_offset(case, like)
        fit = share(case, like.sensors, like.group)
        if fit is None or fit.gain < CHANCE:
            continue
        factor, std = 1.0 - float(fit.size[0]), float(fit.std[0])
        if abs(factor - 1.0) > max(_RELEVANT, _SHOWN * std):
            best = max((factor, *_usual(case, like)), key=partial(_gain, case, like))
            yield scaled(case, *like, best, std, _gain(case, like, best))


def _alike(case: Examination) -> Iterator[_Like]:
    """Yield the sensors of one kind, with each of their units."""
    kinds: dict[tuple[Any, ...], list[str]] = {}
    for name in case.judged:
        source = case.evidence.scenario.sensors[name]
        units = tuple(source.sensor.output.units)
        kinds.setdefault((type(source.sensor), source.signal.type, units), []).append(name)
    for (*_, units), names in kinds.items():
        if len(names) > 1:
            space = case.evidence.scenario.sensors[names[0]].sensor.output
            for unit in dict.fromkeys(units):
                group = tuple(i for i, u in enumerate(units) if u == unit)
                if not {*space.angles} & {space.names[i] for i in group}:
                    yield _Like(tuple(names), group)


def _find_offset(case: Examination, like: _Like) -> Iterator[Finding]:
    """Yield the finding that readings of several sensors are off by the same amount."""
    columns = [
        column
        for name in like.sensors
        for i in like.group
        for column in case.responses.columns('offset', name, str(i))
    ]
    fit = case.responses.fit(np.ones((len(columns), 1)), columns)
    size, std = float(fit.size[0]), float(fit.std[0])
    if fit.gain < CHANCE or abs(size) < _SHOWN * std:
        return
    evidence, label = case.evidence, subject(case, *like)
    unit = evidence.scenario.sensors[like.sensors[0]].sensor.output.units[like.group[0]]

    def mended() -> Evidence:
        return reduce(partial(_shifted, like=like, size=size), like.sensors, evidence)

    yield Finding(
        'bias', label,
        f'readings of {label} are all off by {size:.4g} ± {std:.1g} {unit}'.rstrip() + '.',
        fit.gain**0.5, gain=fit.gain, mended=mended,
    )  # fmt: skip


def _shifted(evidence: Evidence, name: str, like: _Like, size: float) -> Evidence:
    """Return the evidence with an offset of a sensor removed."""
    value = evidence.sensors[name].value.copy()
    value[:, list(like.group)] -= size
    return evidence.with_values(name, value)


def _usual(case: Examination, like: _Like) -> list[float]:
    """Return the factors of units, and of a wrong sign."""
    space = case.evidence.scenario.sensors[like.sensors[0]].sensor.output
    return [-1.0, *conversions(space, like.group)]


def _gain(case: Examination, like: _Like, factor: float) -> float:
    """Return the gain to first order of a factor, less what it costs to shrink readings."""
    if abs(factor) < 1e-6:
        return -np.inf
    return replaced(case, like.sensors, scaling(case, like.sensors[0], like.group, factor))[0]
