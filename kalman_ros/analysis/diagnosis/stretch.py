# SPDX-License-Identifier: Apache-2.0
"""A stretch of a recording in which a sensor reads something else."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array

from .examination import CHANCE, Examination
from .finding import Finding
from .hypotheses import edges
from .noise_levels import innovations
from .passage import DROPPED
from .responses import Columns, responses

#: Fewest readings of a stretch, and its largest share of all readings.
_FEWEST, _MOST = 8, 0.6
#: Into how many parts a piece is divided where a stretch may begin or end.
_FINER = 8
#: Normalised squares are limited to this, so that single outliers make no stretch.
_OUTLYING = 50.0


class Stretch(NamedTuple):
    """An offset from one piece of a recording to another, with its gain."""

    gain: float
    begin: int
    end: int
    size: float
    std: float


def find(case: Examination) -> list[Finding]:
    """Return the sensors that contradict the filter from one time to another, and only then."""
    contradicting = (_find(case, name) for name in case.judged)
    return [*filter(None, contradicting), *_find_offset(case)]


def likeliest(gradient: Array, information: Array) -> Stretch:
    """Return the likeliest stretch of a constant offset over B pieces, (B,) and (B, B).

    It begins after the first piece and ends before the last; others are steps.
    """
    B = len(gradient)
    sums = np.concatenate((np.zeros(1), np.cumsum(gradient)))
    blocks = np.zeros((B + 1, B + 1))
    blocks[1:, 1:] = information.cumsum(axis=0).cumsum(axis=1)
    i, j = np.triu_indices(B, 1)
    i, j = i[i > 0], j[i > 0]
    known = np.maximum(blocks[i, i] + blocks[j, j] - blocks[i, j] - blocks[j, i], 1e-300)
    gains = (sums[j] - sums[i]) ** 2 / known
    best = int(np.argmax(gains))
    size = float((sums[j] - sums[i])[best] / known[best])
    return Stretch(
        float(gains[best]), int(i[best]), int(j[best]), size, float(known[best]) ** -0.5
    )


def _find_offset(case: Examination) -> list[Finding]:
    """Return the likeliest offset of a coordinate in a stretch, with exact times."""
    limits = edges(case.passage)
    if len(limits) < 4:
        return []
    candidates = []
    for name in case.judged:
        for index in range(case.evidence.scenario.sensors[name].sensor.output.size):
            columns = case.responses.columns('offset', name, str(index))
            information = case.responses.information[np.ix_(columns, columns)]
            candidates.append(
                (likeliest(case.responses.gradient[columns], information), name, index)
            )
    coarse, name, index = max(candidates)
    if coarse.gain < CHANCE:
        return []
    around = [
        np.linspace(limits[at - 1], limits[at + 1], 2 * _FINER + 1)
        for at in (coarse.begin, coarse.end)
    ]
    limits = np.unique(np.concatenate(around))
    found = likeliest(*_offsets(case, name, index, limits))
    return [_shifted(case, name, index, found, limits)]


def _offsets(case: Examination, name: str, index: int, limits: Array) -> tuple[Array, Array]:
    """Return gradient (B,) and information (B, B) of offsets of a coordinate in pieces."""
    events = [case.passage.events[i] for i in case.passage.of(name)]
    block = np.zeros((len(events), len(events[0].innovation), len(limits) - 1))
    pieces = np.searchsorted(limits, [event.time for event in events], 'right') - 1
    rows = np.flatnonzero((pieces >= 0) & (pieces < len(limits) - 1))
    block[rows, index, pieces[rows]] = 1.0
    state = np.zeros((len(case.passage.events), len(case.passage.events[0].x), 0))
    labels = [(str(piece),) for piece in range(len(limits) - 1)]
    found = responses(case.passage, Columns(labels, {name: [(0, block)]}, state))
    return found.gradient, found.information


def _shifted(case: Examination, name: str, index: int, found: Stretch, limits: Array) -> Finding:
    """Return the finding that a coordinate is off from one time to another."""
    record, space = case.evidence.sensors[name], case.evidence.scenario.sensors[name].sensor.output
    since, until = float(limits[found.begin]), float(limits[found.end])
    off = np.where((record.stamp >= since) & (record.stamp < until), found.size, 0.0)
    start = case.evidence.start
    return Finding(
        'disturbed', name,
        f'readings of {name} are off from t = {since - start:.3g} to {until - start:.3g} s, '
        f'{space.label(space.names[index])} by {found.size:+.3g} ± {found.std:.1g}, and not '
        'before or after: a magnet, reflections, or a slip.',
        found.gain**0.5, gain=found.gain, parameters=3, figure=innovations(case, name, index),
        mended=lambda: case.evidence.with_column(name, index, record.value[:, index] - off),
    )  # fmt: skip


def heaviest(values: Array) -> tuple[int, int]:
    """Return the half-open range of the largest sum of successive values (N,).

    J. Bentley, Programming Pearls: Algorithm Design Techniques, Communications of the ACM 27(9),
    1984, after J. Kadane.
    """
    sums = np.concatenate((np.zeros(1), np.cumsum(values)))
    lowest = np.minimum.accumulate(sums)
    end = int(np.argmax(sums - lowest))
    return int(np.argmin(sums[: end + 1])), end


def _find(case: Examination, name: str) -> Finding | None:
    events, squares = case.passage.of(name), case.passage.squares(name)
    if len(events) < 2 * _FEWEST:
        return None
    k = len(case.passage.whitened[events[0]])
    begin, end = heaviest(np.minimum(squares, _OUTLYING) - k - DROPPED)
    gain = float(np.sum(squares[begin:end] - k - DROPPED))
    if gain < CHANCE or not _FEWEST <= end - begin <= _MOST * len(events):
        return None
    if np.median(squares[begin:end]) < k + DROPPED:
        return None
    record = case.evidence.sensors[name]
    since, until = (case.passage.events[events[i]].time for i in (begin, end - 1))
    size = float(np.sqrt(np.median(squares[begin:end]) / k))
    within = (record.stamp >= since) & (record.stamp <= until)
    start = case.evidence.start
    return Finding(
        'disturbed', name,
        f'readings of {name} contradict the filter from t = {since - start:.3g} to '
        f'{until - start:.3g} s, by about {size:.2g} standard deviations, and not before or '
        'after: a magnet, reflections, another frame, or a slip.',
        gain**0.5, gain=gain, parameters=2, figure=innovations(case, name, 0),
        mended=lambda: case.evidence.without(name, within),
    )  # fmt: skip
