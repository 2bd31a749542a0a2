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
from .responses import Fit
from .units import classified, conversions, label_of, mixed, mixing, replaced, scaling

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
        fit = _fit(case, like)
        if fit is None or fit.gain < CHANCE:
            continue
        factor, std = 1.0 - float(fit.size[0]), float(fit.std[0])
        if abs(factor - 1.0) > max(_RELEVANT, _SHOWN * std):
            usual = _usual(case, like)
            best = max((factor, *usual), key=partial(_gain, case, like))
            yield _scaled(case, like, best, std, _gain(case, like, best))


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
    evidence, subject = case.evidence, _subject(case, like)
    unit = evidence.scenario.sensors[like.sensors[0]].sensor.output.units[like.group[0]]

    def mended() -> Evidence:
        return reduce(partial(_shifted, like=like, size=size), like.sensors, evidence)

    yield Finding(
        'bias', subject,
        f'readings of {subject} are all off by {size:.4g} ± {std:.1g} {unit}'.rstrip() + '.',
        fit.gain**0.5, gain=fit.gain, mended=mended,
    )  # fmt: skip


def _shifted(evidence: Evidence, name: str, like: _Like, size: float) -> Evidence:
    """Return the evidence with an offset of a sensor removed."""
    value = evidence.sensors[name].value.copy()
    value[:, list(like.group)] -= size
    return evidence.with_values(name, value)


def _subject(case: Examination, like: _Like) -> str:
    """Return the sensors, with their coordinates unless these are all that they have."""
    space = case.evidence.scenario.sensors[like.sensors[0]].sensor.output
    whole = len(like.group) == space.size
    return ' and '.join(
        name if whole else label_of(case, name, like.group) for name in like.sensors
    )


def _usual(case: Examination, like: _Like) -> list[float]:
    """Return the factors of units, and of a wrong sign."""
    space = case.evidence.scenario.sensors[like.sensors[0]].sensor.output
    return [-1.0, *conversions(space, like.group)]


def _fit(case: Examination, like: _Like) -> Fit | None:
    """Return the fit of by how much all of these readings are too large, as a share."""
    columns = [
        column
        for name in like.sensors
        for i in like.group
        for column in case.responses.columns('mix', name, str(i), str(i))
    ]
    if len(columns) < len(like.sensors) * len(like.group):
        return None
    return case.responses.fit(np.ones((len(columns), 1)), columns)


def _gain(case: Examination, like: _Like, factor: float) -> float:
    """Return the gain to first order of a factor, less what it costs to shrink readings."""
    if abs(factor) < 1e-6:
        return -np.inf
    columns, size, dues = list[int](), list[float](), 0.0
    for name in like.sensors:
        M = scaling(case, name, like.group, factor)
        columns += case.responses.columns('read', name)
        size += (np.eye(len(M)) - M).ravel().tolist()
        dues += replaced(case, name, M)[1]
    change, information = np.array(size), case.responses.information[np.ix_(columns, columns)]
    gain = 2.0 * change @ case.responses.gradient[columns] - change @ information @ change
    return float(gain) - dues


def _scaled(case: Examination, like: _Like, factor: float, std: float, gain: float) -> Finding:
    """Return the finding that readings of several sensors must be multiplied by one factor."""
    evidence, space = case.evidence, case.evidence.scenario.sensors[like.sensors[0]].sensor.output
    kind, factor, cause = classified(factor, std, conversions(space, like.group))
    subject = _subject(case, like)
    M = scaling(case, like.sensors[0], like.group, factor)
    dues = sum(replaced(case, name, M)[1] for name in like.sensors)

    def mended() -> Evidence:
        return reduce(lambda before, name: mixed(before, name, M), like.sensors, evidence)

    def again(after: Examination) -> Finding | None:
        fit = _fit(after, like)
        if fit is None or not fit.remains:
            return None
        nearer = factor * (1.0 - float(fit.size[0]))
        return _scaled(case, like, nearer, abs(factor) * float(fit.std[0]), gain)

    changes = [mixing(evidence, name, M) for name in like.sensors]
    change = {key: value for each in changes for key, value in each.items()}
    shared = ' A parameter that they share, such as the radius of wheels, does the same.'
    return Finding(
        kind, subject,
        f'readings of {subject} fit the model once all are multiplied by {factor:.4g}{cause}.'
        f'{shared if kind == "scale" else ""}',
        max(gain, 0.0) ** 0.5, change if all(changes) else {}, gain=gain, dues=dues, mended=mended,
        again=again if kind == 'scale' else None,
    )  # fmt: skip
