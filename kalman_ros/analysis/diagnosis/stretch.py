# SPDX-License-Identifier: Apache-2.0
"""Stretches of a recording in which a sensor reads something else."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array

from .examination import CHANCE, Examination
from .finding import Finding
from .hypotheses import edges, offset_responses
from .noise_levels import innovations
from .passage import DROPPED
from .responses import fitted

#: Fewest readings of a stretch, and its largest share of all readings, or of the time.
_FEWEST, _MOST = 8, 0.6
#: Into how many parts a piece is divided where a stretch may begin or end.
_FINER = 8
#: Most stretches in the search, of which more are an offset that moves; most that are named, and
#: most offsets in the search.
_PARTS, _NAMED, _PIECES = 25, 3, 240
#: More stretches, or those of more than most of a recording, are an offset that moves.
_MOST_STRETCHES = 12
#: Fewest readings of a piece, on average.
_FEW = 4
#: A sensor is examined in shorter pieces from this share of the largest gain on.
_CLOSE = 0.4
#: An offset is large from this share of the largest one on; what the others may explain, where
#: all cover more than the last share of the pieces.
_LARGE, _NEARLY, _COVERED = 0.5, 0.05, 0.5
#: A stretch lasts to the end if it ends within this share of the recording before it.
_AT_THE_END = 0.02
#: How many stretches that gain too little are skipped.
_MISSES = 3
#: Share of the information that is added, so that what shows in nothing has an inverse, and share
#: of sums that is lost by their difference.
_LEAST, _ROUNDING = 1e-9, 1e-14
#: Normalised squares are limited to this, so that single outliers make no stretch.
_OUTLYING = 50.0


class Offsets(NamedTuple):
    """The stretches in which a sensor is off, each by the same at all times of it.

    A stretch is the half-open range of its pieces, ``size`` (K, k) has the offset of each, ``std``
    (K, k) its standard deviation, and ``gain`` is that of all together. ``coordinates`` are those
    of the sensor that are off.
    """

    stretches: list[tuple[int, int]]
    size: Array
    std: Array
    gain: float
    coordinates: list[int] = []  # noqa: RUF012


def find(case: Examination) -> list[Finding]:
    """Return the sensors that contradict the filter from one time to another, and only then."""
    contradicting = (_find(case, name) for name in case.judged)
    return [*filter(None, contradicting), *_find_offsets(case)]


class Pieces:
    """The regression on offsets of a sensor in B pieces, with sums over stretches of pieces.

    Parameters
    ----------
    gradient, information
        Gradient (B, k) and information (B, k, B, k).
    """

    def __init__(self, gradient: Array, information: Array) -> None:
        B, k = gradient.shape
        self.gradient = gradient
        self._sums = np.zeros((B + 1, k))
        np.cumsum(gradient, axis=0, out=self._sums[1:])
        #: Information of each piece with all pieces before an edge, and of all before one edge
        #: with all before another.
        self._rows = np.zeros((B, k, B + 1, k))
        np.cumsum(information, axis=2, out=self._rows[:, :, 1:])
        self._blocks = np.zeros((B + 1, k, B + 1, k))
        np.cumsum(self._rows, axis=0, out=self._blocks[1:])

    def of(self, coordinates: Sequence[int]) -> Pieces:
        """Return the regression on offsets of some coordinates alone."""
        part, chosen = copy(self), list(coordinates)
        part.gradient, part._sums = self.gradient[:, chosen], self._sums[:, chosen]
        part._rows = self._rows[:, chosen][..., chosen]
        part._blocks = self._blocks[:, chosen][..., chosen]
        return part

    def likeliest(self, gradient: Array, free: Array) -> tuple[int, int] | None:
        """Return the likeliest stretch of a constant offset, by a gradient (B, k).

        It begins after the first piece and ends before the last, since others are steps, and all
        its pieces are ``free`` (B,). None if there is none.
        """
        B, k = gradient.shape
        sums = np.concatenate((np.zeros((1, k)), np.cumsum(gradient, axis=0)))
        blocks = self._blocks.transpose(0, 2, 1, 3)
        taken = np.concatenate((np.zeros(1), np.cumsum(np.logical_not(free))))
        i, j = np.triu_indices(B, 1)
        inside = (i > 0) & (taken[j] == taken[i])
        i, j = i[inside], j[inside]
        if not len(i):
            return None
        both = blocks[i, i] + blocks[j, j]
        known = both - blocks[i, j] - blocks[j, i]
        # what is left of large sums may be their rounding alone
        least = _LEAST * np.abs(_traces(known)) + _ROUNDING * _traces(both) + 1e-300
        known += least[:, None, None] * np.eye(k)
        g = sums[j] - sums[i]
        gains = np.einsum('pi,pi->p', g, np.linalg.solve(known, g[:, :, None])[:, :, 0])
        best = int(np.argmax(gains))
        return int(i[best]), int(j[best])

    def fitted(self, stretches: list[tuple[int, int]]) -> Offsets:
        """Return the offsets of given stretches."""
        begin, end = np.transpose(stretches)
        gradient = self._sums[end] - self._sums[begin]
        rows = self._blocks[end] - self._blocks[begin]
        information = rows[:, :, end] - rows[:, :, begin]
        size = gradient.size
        fit = fitted(gradient.ravel(), information.reshape(size, size))
        k = gradient.shape[1]
        return Offsets(stretches, fit.size.reshape(-1, k), fit.std.reshape(-1, k), fit.gain)

    def left(self, offsets: Offsets) -> Array:
        """Return the gradient (B, k) that offsets leave."""
        begin, end = np.transpose(offsets.stretches)
        rows = self._rows[:, :, end] - self._rows[:, :, begin]
        return np.asarray(self.gradient - np.einsum('bisj,sj->bi', rows, offsets.size))


def _traces(matrices: Array) -> Array:
    return np.asarray(np.trace(matrices, axis1=1, axis2=2))


def several(pieces: Pieces, cost: float) -> Offsets | None:
    """Return the stretches of which each gains more than ``cost``.

    Forward selection: a stretch is added where there is none, or divides one into those before,
    within and after it. In the end those that gain too little are dropped, such as what lies
    between two clusters that were found as one.
    """
    best: Offsets | None = None
    left, misses = pieces.gradient, 0
    refused = np.zeros(len(left), dtype=bool)
    while best is None or len(best.stretches) < _PARTS:
        chosen = best.stretches if best else []
        free = np.logical_not(refused)
        for begin, end in chosen:
            free[[begin - 1, begin, end - 1, end]] = False
        likeliest = pieces.likeliest(left, free)
        if likeliest is None:
            break
        begin, end = likeliest
        whole = [stretch for stretch in chosen if stretch[0] < begin and end < stretch[1]]
        kept = [stretch for stretch in chosen if stretch not in whole]
        around = [(whole[0][0], begin), (end, whole[0][1])] if whole else []
        fit = pieces.fitted(sorted([*kept, *around, likeliest]))
        if fit.gain - (best.gain if best else 0.0) > cost:
            best, left = fit, pieces.left(fit)
        elif best is None or misses == _MISSES:
            break
        else:
            refused[begin:end], misses = True, misses + 1
    return _pruned(pieces, _largest(pieces, best, cost), cost) if best else None


def _largest(pieces: Pieces, offsets: Offsets, cost: float) -> Offsets:
    """Return the stretches of large offsets alone, if these explain nearly as much.

    Where no other sensor tells the level, an offset of the readings between clusters fits, too.
    """
    covered = sum(end - begin for begin, end in offsets.stretches)
    if covered < _COVERED * len(pieces.gradient):
        return offsets
    size = np.linalg.norm(offsets.size / np.maximum(offsets.std, 1e-300), axis=1)
    large = size >= _LARGE * size.max()
    if large.all():
        return offsets
    fewer = pieces.fitted([stretch for stretch, kept in zip(offsets.stretches, large) if kept])
    least = max(cost * int((~large).sum()), _NEARLY * offsets.gain)
    return fewer if offsets.gain - fewer.gain < least else offsets


def _pruned(pieces: Pieces, offsets: Offsets, cost: float) -> Offsets | None:
    """Return the stretches without those that gain less than ``cost``, the least one first."""
    while len(offsets.stretches) > 1:
        fewer = [
            pieces.fitted([stretch for stretch in offsets.stretches if stretch != out])
            for out in offsets.stretches
        ]
        best = max(fewer, key=lambda fit: fit.gain)
        if offsets.gain - best.gain > cost:
            break
        offsets = best
    return offsets if offsets.gain > cost else None


def _find_offsets(case: Examination) -> Iterator[Finding]:
    """Yield the sensors that are off in one stretch or in several, with exact times."""
    limits = edges(case.passage)
    if len(limits) < 4:
        return
    promised = {name: several(_known_offsets(case, name, limits), CHANCE) for name in case.judged}
    gains = {name: offsets.gain for name, offsets in promised.items() if offsets}
    for name, gain in gains.items():
        if gain > _CLOSE * max(gains.values()):
            yield from _find_exactly(case, name, limits)


def _find_exactly(case: Examination, name: str, limits: Array) -> Iterator[Finding]:
    """Yield the finding of the offsets of a sensor, if pieces much shorter show them, too."""
    k = case.evidence.scenario.sensors[name].sensor.output.size
    readings = len(case.passage.of(name))
    pieces = int(np.clip(readings / _FEW, len(limits) - 1, max(_PIECES // k, len(limits) - 1)))
    limits = np.linspace(limits[0], limits[-1], pieces + 1)
    coarse = _several_of(case, _offsets(case, name, limits))
    if coarse is None or len(coarse.stretches) >= _PARTS:
        return
    around = [
        np.linspace(limits[at - 1], limits[at + 1], 2 * _FINER + 1)
        for stretch in coarse.stretches
        for at in stretch
    ]
    limits = np.unique(np.concatenate([limits[[0, -1]], *around]))
    fine = _several_of(case, _offsets(case, name, limits))
    if fine is None or len(fine.stretches) > _MOST_STRETCHES or _is_step(fine, limits):
        return
    if sum(limits[end] - limits[begin] for begin, end in fine.stretches) < _MOST * np.ptp(limits):
        yield _shifted(case, name, fine, limits)


def _is_step(offsets: Offsets, limits: Array) -> bool:
    """Return whether a sensor is off from a time on, until the recording ends."""
    ((_, end), *others) = offsets.stretches
    return not others and bool(limits[-1] - limits[end] < _AT_THE_END * np.ptp(limits))


def _several_of(case: Examination, pieces: Pieces) -> Offsets | None:
    """Return the likeliest stretches of all coordinates together, or of one of them alone."""
    k = pieces.gradient.shape[1]
    price = float(np.log(max(case.passage.sizes.sum(), 2)))
    best, most = None, 0.0
    for group in dict.fromkeys([tuple(range(k)), *((index,) for index in range(k))]):
        chosen = list(group)
        cost = (len(chosen) + 2) * price
        offsets = several(pieces.of(chosen), max(cost, CHANCE))
        net = 0.0 if offsets is None else offsets.gain - cost * len(offsets.stretches)
        if offsets is not None and net > most:
            best, most = offsets._replace(coordinates=chosen), net
    return best


def _known_offsets(case: Examination, name: str, limits: Array) -> Pieces:
    """Return the regression on the offsets that all cases have."""
    columns = case.responses.columns('offset', name)
    information = case.responses.information[np.ix_(columns, columns)]
    return _by_piece(case.responses.gradient[columns], information, len(limits) - 1)


def _offsets(case: Examination, name: str, limits: Array) -> Pieces:
    """Return the regression on offsets of a sensor in pieces between ``limits``."""
    regression = offset_responses(case.passage, name, limits)
    return _by_piece(regression.gradient, regression.information, len(limits) - 1)


def _by_piece(gradient: Array, information: Array, B: int) -> Pieces:
    """Return the regression on offsets in B pieces, which stand behind each other."""
    k = len(gradient) // B
    return Pieces(gradient.reshape(B, k), information.reshape(B, k, B, k))


def _shifted(case: Examination, name: str, offsets: Offsets, limits: Array) -> Finding:
    """Return the finding that a sensor is off from one time to another, once or several times."""
    record, space = case.evidence.sensors[name], case.evidence.scenario.sensors[name].sensor.output
    value, words, start = record.value.copy(), [], case.evidence.start
    for (begin, end), size, std in zip(offsets.stretches, offsets.size, offsets.std):
        since, until = float(limits[begin]), float(limits[end])
        rows = np.flatnonzero((record.stamp >= since) & (record.stamp < until))
        value[np.ix_(rows, np.array(offsets.coordinates))] -= size
        by = ', '.join(
            f'{space.label(space.names[index])} by {off:+.3g} ± {about:.1g}'
            for index, off, about in zip(offsets.coordinates, size, std)
        )
        words.append(f'from t = {since - start:.3g} to {until - start:.3g} s, {by}')
    K, k = offsets.size.shape
    more = f'; and {K - _NAMED} times more' if K > _NAMED else ''
    main = offsets.coordinates[int(np.argmax(np.abs(offsets.size / offsets.std).max(axis=0)))]
    return Finding(
        'disturbed', name,
        f'readings of {name} are off {"; ".join(words[:_NAMED])}{more}, and not before or after: '
        'a magnet, reflections, or a slip.',
        offsets.gain**0.5, gain=offsets.gain, parameters=K * (k + 2),
        figure=innovations(case, name, main),
        mended=lambda: case.evidence.with_values(name, value),
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
    k = int(case.passage.sizes[events[0]])
    begin, end = heaviest(np.minimum(squares, _OUTLYING) - k - DROPPED)
    gain = float(np.sum(squares[begin:end] - k - DROPPED))
    if gain < CHANCE or not _FEWEST <= end - begin <= _MOST * len(events):
        return None
    if np.median(squares[begin:end]) < k + DROPPED:
        return None
    record = case.evidence.sensors[name]
    since, until = case.passage.series('time')[events[[begin, end - 1]]].tolist()
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
