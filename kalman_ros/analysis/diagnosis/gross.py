# SPDX-License-Identifier: Apache-2.0
"""Readings so wrong that the filter is lost, and no linearisation along its path holds."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice, permutations
from math import inf, log, pi

import numpy as np

from . import exchanged, input_axes
from .examination import CHANCE, Examination
from .filter_pass import passage
from .finding import Finding
from .left_out import left_out
from .mounting import (
    axes_exchanged,
    best_rotation,
    blocks_exchanged,
    from_north,
    nearest_rotation,
    turned,
    vectors,
    within,
)
from .passage import Passage, explained
from .units import conversions, groups, mixed, scaled

#: A filter is lost if its squared innovations exceed their expectation by this factor.
_LOST = 2.0
#: Candidates are compared on the first seconds, or as many readings of the slowest sensor, and on
#: these after the filter gets lost. Candidates that increase the misfit are dropped after the
#: second, shorter duration.
_SECONDS, _SOONER = 8.0, 2.0
#: A filter that gets lost after more events than these is compared on the first seconds alone,
#: and is not lost before the second number of values.
_MOST_EVENTS, _FEW = 4000, 50
#: Signs are tried where the squared innovations exceed their expectation by this factor, on as
#: many events.
_SUSPECT, _PART = 1.2, 3000
#: Rotations are estimated on the first seconds; no smaller rotation (rad) causes a lost filter.
_ROTATION_SECONDS, _SMALLEST_ROTATION = 20.0, 0.2
#: Two sizes are alike if the logarithm of their ratio is below this.
_ALIKE = 0.3
#: A factor by the predictions of the other sensors takes as many readings, and this correlation.
_FEWEST, _CORRELATED = 8, 0.7
#: Most exchanges within a sensor that are tried.
_EXCHANGES = 10
#: Trial factors of each coordinate.
_FACTORS = (-1.0, pi / 180.0, 180.0 / pi, 1.0 / 3.6, 1e-3, 9.80665)


def find(case: Examination) -> list[Finding]:
    """Return the units, signs, exchanges and rotations of axes that recover a lost filter.

    Each candidate is evaluated by a filter pass over the first seconds. For a linear system the
    regressions give the same result at once. A filter that trusts its other sensors is not lost by
    a wrong sign, but follows it now and then, so that no linearisation shows it: signs and
    exchanges are tried there, too.
    """
    if case.evidence.scenario.plan.linear or not _is_suspect(case):
        return []
    first_span, span = (
        _Span(case, until)
        for until in (_until(case, _SOONER), _until(case, _SECONDS, _onset(case)))
    )
    candidates, most = _candidates(case), 2
    if not lost(case):
        span = _Span(case, float(case.passage.series('time')[:_PART][-1]))
        candidates, most = _signs(case), 4
    ratio = len(case.passage.events) / len(span)
    findings = []
    for finding in candidates:
        try:
            if first_span.gain(finding) < -CHANCE:
                continue
            gain = ratio * span.gain(finding) - finding.dues
        except np.linalg.LinAlgError:
            continue
        if gain > CHANCE:
            findings.append(replace(finding, gain=gain, z=gain**0.5))
    return sorted(findings, key=lambda finding: -finding.gain)[:most]


def _is_suspect(case: Examination) -> bool:
    """Return whether the errors of the filter are larger than small causes make them."""
    return _mean(case.passage) >= _SUSPECT


def _mean(passage: Passage) -> float:
    """Return the mean of e'e / k over all readings."""
    return float(np.mean(passage.square / passage.sizes))


def _signs(case: Examination) -> Iterator[Finding]:
    """Yield each coordinate with the other sign, and the exchange of two."""
    for name in case.judged:
        space = case.evidence.scenario.sensors[name].sensor.output
        for index in range(space.size):
            yield scaled(case, (name,), (index,), -1.0, 0.0, 0.0)
        if space.size == 2 and space.units[0] == space.units[1]:
            yield axes_exchanged(case, name, (1, 0), 0.0)


def _onset(case: Examination) -> float:
    """Return the stamp at which the filter gets lost; the first one if that is late.

    A robot at rest follows the model whatever the scale of a rate gyro is.
    """
    passage = case.passage
    sums, numbers = (
        np.cumsum(values[:_MOST_EVENTS]) for values in (passage.square, passage.sizes)
    )
    beyond = np.flatnonzero(sums > _LOST * np.maximum(numbers, _FEW))
    return float(passage.series('time')[beyond[0] if len(beyond) else 0])


def _until(case: Examination, seconds: float, begin: float = -inf) -> float:
    """Return the stamp some seconds after a stamp, the first one by default.

    It is a later one if a sensor has fewer readings by then than seconds, up to `_MOST_EVENTS`.
    """
    every = case.passage.series('time')
    begin = max(begin, float(every[0]))
    ends = [begin + seconds]
    for name in case.judged:
        times = case.passage.series('time', name)
        times = times[times >= begin]
        ends += times[: int(seconds)][-1:].tolist()
    last = float(every[min(np.searchsorted(every, begin) + _MOST_EVENTS, len(every)) - 1])
    return max(begin + seconds, min(max(ends), last))


def beginning(case: Examination) -> Examination:
    """Return the first seconds of a case, in which a filter is not yet lost.

    Linearisations hold there, and find causes of the later misfit, too.
    """
    until = _until(case, _SECONDS)
    return Examination(case.evidence, strict=False, known=case.passage.until(until))


class _Span:
    """The first seconds of a recording, up to a stamp, on which candidates are evaluated."""

    def __init__(self, case: Examination, until: float) -> None:
        self._until, self._before = until, case.passage.until(until)

    def __len__(self) -> int:
        return len(self._before.events)

    def gain(self, finding: Finding) -> float:
        """Return the gain of a finding on this span.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the filter fails after the correction.
        """
        assert finding.mended is not None
        return explained(self._before, passage(finding.mended(), self._until))


def lost(case: Examination) -> bool:
    """Return whether the errors of the filter are so large that no linearisation holds."""
    return not case.evidence.scenario.plan.linear and _mean(case.passage) >= _LOST


def _candidates(case: Examination) -> Iterator[Finding]:
    for name in case.judged:
        space = case.evidence.scenario.sensors[name].sensor.output
        for group in groups(space):
            sensible = conversions(space, group)
            usual = _usual_factors(sensible)
            for factor in dict.fromkeys((*usual, *_by_size(case, name, group, sensible))):
                yield scaled(case, (name,), group, factor, 0.0, 0.0)
        if space.size == 2 and space.units[0] != space.units[1]:
            yield axes_exchanged(case, name, (1, 0), 0.0)
        yield from islice(blocks_exchanged(case, name), _EXCHANGES)
        for angle in space.angles:
            yield from_north(case, name, space.names.index(angle))
        yield from _by_others(case, name)
        yield from _turned_or_exchanged(case, name)
    yield from exchanged.candidates(case)
    yield from _input_candidates(case)


def _usual_factors(sensible: Container[float]) -> list[float]:
    return [factor for factor in _FACTORS if factor < 0.0 or factor in sensible]


def _input_candidates(case: Examination) -> Iterator[Finding]:
    """Yield the signs, units and rotations of an instrument behind the input."""
    space = case.evidence.scenario.model.input
    for group in groups(space):
        for factor in _usual_factors(conversions(space, group)):
            yield input_axes.multiplied(case, group, factor)
    yield from input_axes.exchanges(case)
    yield from input_axes.by_passes(case, _until(case, _SOONER))


def _by_size(
    case: Examination, name: str, group: Sequence[int], conversions: Iterable[float]
) -> list[float]:
    """Return the conversion by which readings have the size of the first prediction."""
    first, record = case.evidence.scenario.initial_belief.mean, case.evidence.sensors[name]
    expected = case.evidence.scenario.sensors[name].sensor.measure(first)[list(group)]
    read = np.nanmedian(record.value[:, list(group)], axis=0)
    if not np.all(expected * read > 0.0):
        return []
    ratio = float(np.median(expected / read))
    near = min(conversions, key=lambda factor: abs(log(ratio / factor)), default=1.0)
    return [near] if abs(log(ratio / near)) < _ALIKE < abs(log(ratio)) else []


def _by_others(case: Examination, name: str) -> Iterator[Finding]:
    """Yield the factor of each group that fits the predictions of the other sensors."""
    others = left_out(case, name, _until(case, _ROTATION_SECONDS), _FEWEST)
    for group in groups(case.evidence.scenario.sensors[name].sensor.output) if others else ():
        assert others is not None
        y, expected = others.record.value[:, group], others.predicted[:, group]
        product, square = float(np.sum(expected * y)), float(np.sum(y**2))
        size = (square * float(np.sum(expected**2))) ** 0.5
        if product > _CORRELATED * size and abs(log(product / square)) > _ALIKE:
            yield scaled(case, (name,), group, product / square, 0.0, 0.0)


def _turned_or_exchanged(case: Examination, name: str) -> Iterator[Finding]:
    """Yield the rotation and the order of axes that fit the predictions of the other sensors.

    There is one of each for each vector. After the correction the filter is no longer lost, and
    the regressions hold.
    """
    space = case.evidence.scenario.sensors[name].sensor.output
    axes = vectors(space)
    until = _until(case, _ROTATION_SECONDS)
    others = left_out(case, name, until) if axes else None
    if others is None:
        return
    for group in axes:
        y, expected = others.record.value[:, group], others.predicted[:, group]
        orders = permutations(range(len(group)))
        order = min(orders, key=lambda order: float(np.sum((y[:, order] - expected) ** 2)))
        if len(group) == 3 and order != (0, 1, 2):
            whole = list(range(space.size))
            for i, j in enumerate(order):
                whole[group[i]] = group[j]
            yield axes_exchanged(case, name, tuple(whole), 0.0)
        turn = nearest_rotation(expected.T @ y)
        if np.linalg.norm(turn - np.eye(len(turn))) < _SMALLEST_ROTATION:
            continue
        rotated = mixed(case.evidence, name, within(case, name, group, turn))
        first_pass = passage(rotated, until, strict=False)
        turn = (
            best_rotation(Examination(rotated, strict=False, known=first_pass), name, group) @ turn
        )
        rms = float(np.sqrt(np.mean(np.sum((y @ turn.T - expected) ** 2, axis=1))))
        residual = (
            f'Then {rms:.3g} {space.units[group[0]]} rms are left to what the others predict.'
        )
        yield turned(case, name, group, turn, 0.0, residual)
