# SPDX-License-Identifier: Apache-2.0
"""Noise that two sensors have in common.

The whitened innovations of a filter are independent (T. Kailath, An Innovations Approach to
Least-Squares Estimation, IEEE Trans. Automatic Control 13(6), 1968). Noise in common correlates
those of readings at the same time, and so does a cause that the model lacks. The likelihood tells
them apart: that of the pass with a number that the noise of both readings of a pair contains; all
noise keeps its declared size.
"""

from __future__ import annotations

from functools import cache
from itertools import combinations
from math import log1p
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array

from .error_filter import ErrorFilter, errors_of
from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding
from .passage import Passage

#: Fewest pairs of readings, and the smallest correlation of innovations that is examined.
_FEWEST, _RELEVANT = 50, 0.1
#: Most readings of a pass: each trial is a filter pass.
_LONGEST = 20_000
#: Other coordinates are correlated, too, if they are by this share of the largest correlation.
_ALSO = 0.5
#: How much larger it is than that of readings of both after each other, and of one alone, which
#: show another cause.
_MORE, _ALONE = 1.2, 1.5
#: Largest difference of the stamps of a pair, as a share of the interval of the sensor.
_TOGETHER = 0.6
#: Trial correlations of the noise, and their refinement.
_TRIALS, _FINER = (0.2, 0.4, 0.6, 0.8, 0.95), (-0.1, -0.05, 0.05, 0.1)
#: The largest share of noise that is in common, so that what is left has an inverse.
_MOST = 0.99
#: Seed of the independent noise in place of that in common.
_SEED = 3


class _Pair(NamedTuple):
    """Two sensors, the coordinates that are correlated, and their readings at the same time.

    Parameters
    ----------
    names
        Names of the two.
    coordinates, signs
        Coordinates of either that are correlated (c, 2), the most correlated first, and the signs
        of their correlations (c,).
    positions
        Positions of the paired readings among those of each sensor (N, 2).
    """

    names: tuple[str, str]
    coordinates: Any
    signs: Array
    positions: Any


def find(case: Examination) -> list[Finding]:
    """Return the pairs of sensors of which the noise is in part the same."""
    if len(case.passage.events) > _LONGEST:
        return []
    findings = [_find(case, *names) for names in combinations(case.judged, 2)]
    return [finding for finding in findings if finding is not None]


def _find(case: Examination, one: str, other: str) -> Finding | None:
    pair = _suspected(case.passage, one, other)
    if pair is None:
        return None

    @cache
    def gain(share: float) -> float:
        try:
            return case.passage.misfit - _with_common(case.passage, pair, share).misfit
        except np.linalg.LinAlgError:
            return -np.inf

    best = max(_TRIALS, key=gain)
    best = max((min(best + by, _MOST) for by in (0.0, *_FINER)), key=gain)
    return _finding(case, pair, best, gain(best)) if gain(best) > CHANCE else None


def _suspected(passage: Passage, one: str, other: str) -> _Pair | None:
    """Return the coordinates of two sensors that are correlated most; None if none are."""
    positions = _together(passage, one, other)
    if len(positions) < _FEWEST:
        return None
    A, B = (passage.whitened_of(name)[at] for name, at in zip((one, other), positions.T))
    scale = np.sqrt(np.outer(np.mean(A * A, axis=0), np.mean(B * B, axis=0)))
    r = (A.T @ B) / len(A) / np.maximum(scale, 1e-300)
    if not np.abs(r).max() > _RELEVANT:
        return None
    coordinates = _correlated(np.abs(r))
    i, j = coordinates[0]
    correlation = float(np.clip(r[i, j], -0.999999, 0.999999))
    apart = max(_mean_product(A[1:, i], B[:-1, j]), _mean_product(A[:-1, i], B[1:, j]))
    in_time = max(_mean_product(series[1:], series[:-1]) for series in (A[:, i], B[:, j]))
    least = max(_RELEVANT, _MORE * apart, _ALONE * in_time)
    if -len(A) * log1p(-(correlation**2)) < CHANCE or abs(correlation) < least:
        return None
    return _Pair((one, other), coordinates, np.sign(r[tuple(coordinates.T)]), positions)


def _correlated(r: Array) -> Any:
    """Return the rows and columns of the largest numbers (c, 2), each once, the largest first."""
    left, chosen, least = r.copy(), list[tuple[int, int]](), _ALSO * float(r.max())
    while left.max() > least:
        i, j = (int(index) for index in np.unravel_index(int(np.argmax(left)), r.shape))
        chosen.append((i, j))
        left[i], left[:, j] = 0.0, 0.0
    return np.array(chosen)


def _mean_product(a: Array, b: Array) -> float:
    """Return the magnitude of the correlation of numbers (N,) of zero mean."""
    return abs(float(a @ b)) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300)


def _together(passage: Passage, one: str, other: str) -> Any:
    """Return the positions of readings of two sensors that are nearest to each other (N, 2)."""
    times = [passage.series('time', name) for name in (one, other)]
    if min(len(of_one) for of_one in times) < 2:
        return np.zeros((0, 2), dtype=int)
    forth, back = _nearest(*times), _nearest(*reversed(times))
    first = np.flatnonzero(back[forth] == np.arange(len(forth)))
    second = forth[first]
    interval = min(float(np.median(np.diff(of_one))) for of_one in times)
    close = np.abs(times[0][first] - times[1][second]) <= _TOGETHER * interval
    return np.column_stack((first[close], second[close]))


def _nearest(times: Array, among: Array) -> Any:
    """Return the positions of the nearest of other times (N,)."""
    right = np.clip(np.searchsorted(among, times), 1, len(among) - 1)
    return np.where(times - among[right - 1] < among[right] - times, right - 1, right)


def _loads(passage: Passage, pair: _Pair, share: float) -> dict[str, Array]:
    """Return what the readings of the two sensors have of unit noises in common (N, k, c)."""
    loads, c = {}, len(pair.signs)
    for name, coordinates, at, signs in zip(
        pair.names, pair.coordinates.T, pair.positions.T, (np.ones(c), pair.signs)
    ):
        load = np.zeros((*passage.series('innovation', name).shape, c))
        R = passage.series('R', name)[at]
        root = np.linalg.cholesky(R[:, coordinates][:, :, coordinates])
        spread = R[:, :, coordinates] @ np.linalg.inv(root).swapaxes(1, 2)
        load[at] = signs * np.sqrt(share) * spread
        loads[name] = load
    return loads


def _with_common(passage: Passage, pair: _Pair, share: float) -> ErrorFilter:
    """Return the filter in which a share of the noise of a pair is in common.

    Each pair has another draw, from its first reading to its second.
    """
    c = len(pair.signs)
    loads = _loads(passage, pair, share)
    errors = errors_of(passage, loads)
    kept = np.zeros(len(errors.F))
    ends = np.sort(
        [passage.of(name)[at] for name, at in zip(pair.names, pair.positions.T)], axis=0
    )
    for begin, end in ends.T.tolist():
        kept[begin + 1 : end + 1] = 1.0
    common = np.arange(-c, 0)
    errors.F[:, common, common], errors.Q[:, common, common] = kept[:, None], 1.0 - kept[:, None]
    for name, load in loads.items():
        k = load.shape[1]
        errors.R[passage.rows_of(name), :k] -= (load @ load.swapaxes(1, 2)).reshape(-1, k)
    return ErrorFilter(errors, passage.series('P')[0], np.eye(c))


def _finding(case: Examination, pair: _Pair, share: float, gain: float) -> Finding:
    """Return the finding that a share of the noise of two sensors is in common."""
    passage, sensors = case.passage, case.evidence.scenario.sensors

    def mended() -> Evidence:
        """Return the evidence with noise of the same size that is independent."""
        evidence, rng = case.evidence, np.random.default_rng(_SEED)
        path = _with_common(passage, pair, share).path(slice(None))
        for (name, load), at in zip(_loads(passage, pair, share).items(), pair.positions.T):
            common = path[passage.of(name), :, None]
            value = evidence.sensors[name].value.copy()
            fresh = rng.standard_normal(common.shape)
            rows = passage.series('index', name)[at]
            value[rows] += (load @ (fresh - common))[at, :, 0]
            evidence = evidence.with_values(name, value)
        return evidence

    most = [*zip(pair.names, pair.positions.T, pair.coordinates[0].tolist())]
    first, second = (
        f'{name}.{sensors[name].sensor.output.names[coordinate]}' for name, _, coordinate in most
    )
    A, B = (passage.whitened_of(name)[at, coordinate] for name, at, coordinate in most)
    others = len(pair.signs) - 1
    more = f' (and of {others} more pair{"s" if others > 1 else ""})' if others else ''
    curves = (Curve('at the same time', A, B, 'dots'),)
    one, other = pair.names
    return Finding(
        'correlated noise', f'{one} and {other}',
        f'the noise of {first} and {second}{more} has the correlation '
        f'{pair.signs[0] * share:+.2f} at the same time: it is in part the same (one receiver, '
        'one clock, one vibration). The filter takes them for independent and is surer than it '
        'should be: give both as one sensor with its whole covariance, or use one of them.',
        gain**0.5, gain=gain, is_exact=True, mended=mended,
        figure=Figure('Whitened innovations', first, second, curves),
    )  # fmt: skip
