# SPDX-License-Identifier: Apache-2.0
"""The estimate of a replay beside poses of another estimator, and beside true ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import degrees, nan
from typing import Any

import numpy as np

from kalman_ros.analysis.pose_paths import PosePath, Separation, separation
from kalman_ros.bags.replayed import Replayed
from kalman_ros.core import Array
from kalman_ros.core import rotations as so3
from kalman_ros.report.run_tables import plain
from kalman_ros.report.sheet import Sheet

#: Share of the time both are known, and the fewest seconds, over which a distance grows.
_WINDOW, _SHORTEST = 0.02, 1.0
#: Speed of a jump by the 95 % quantile of speeds, and its least share of the growth.
_JUMP, _PART = 5.0, 0.3
#: A share of rejected readings, and how many times that of the whole, that is unusual.
_REJECTED, _MORE = 0.2, 2.0
#: A heading in rad, and a share of the way, in which two estimates differ.
_TURNED, _FARTHER = 0.05, 0.05


@dataclass(frozen=True)
class Comparison:
    """Two estimates of one recording.

    Parameters
    ----------
    topic
        Topic of the other one, or of the true poses if there is no other one.
    apart
        How far the estimate is from the other one; None if nothing is known at one time.
    errors
        How far each of them is from the truth, by name; empty without a truth.
    other
        Poses of the other one.
    aligned
        As ``apart``, moved and turned to the other one, if that is not.
    """

    topic: str
    apart: Separation | None
    errors: Mapping[str, Separation]
    other: PosePath
    aligned: Separation | None = None


def comparison(run: Replayed, topic: str) -> Comparison | None:
    """Return the comparison of a replay; None without poses to compare with."""
    ours, truth = run.poses(), run.reference()
    other = run.against if run.against is not None else run.true_poses
    if other is None:
        return None
    if ours is None:
        return Comparison(topic, None, {}, other)
    named = {'estimate': ours, **({topic: run.against} if run.against is not None else {})}
    both = {} if truth is None else {name: _apart(path, truth) for name, path in named.items()}
    errors = {name: error for name, error in both.items() if error is not None}
    if run.against is None:
        return Comparison(topic, None, errors, other)
    apart, aligned = _apart(ours, run.against), None
    if apart is not None and not apart.aligned:
        aligned = separation(ours, run.against, align=True)
    return Comparison(topic, apart, errors, other, aligned)


def _apart(path: PosePath, reference: PosePath) -> Separation | None:
    """Return how far two paths are apart, in one frame if theirs have other names."""
    frames = {path.frame, reference.frame} - {''}
    return separation(path, reference, align=len(frames) > 1)


def sheet(pair: Comparison) -> tuple[str, Sheet]:
    """Return the title and the table: a row for each pair, lengths in m and angles in deg."""
    rows = _rows(pair)
    if not rows:
        return '', Sheet([], [])
    lengths = sorted({part.length for row in rows.values() for part in row.relative})
    parts = [{part.length: part for part in row.relative} for row in rows.values()]
    columns = [
        ('over s', [_cell(_span(row)) for row in rows.values()]),
        ('ATE', [_cell(row.ate) for row in rows.values()]),
        ('heading', [_cell(degrees(row.heading)) for row in rows.values()]),
    ]
    for length in lengths:
        relative = [part.get(length) for part in parts]
        columns.append(
            (
                f'in {length:g} m',
                ['' if part is None else _cell(part.position) for part in relative],
            )
        )
        turned = ['' if part is None else _cell(degrees(part.rotation)) for part in relative]
        columns.append((f'{length:g} m turned', turned))
    columns.append(('NEES', [_cell(row.nees) for row in rows.values()]))
    return 'Poses beside others: RMS in m, headings in deg', Sheet(list(rows), columns)


def _rows(pair: Comparison) -> dict[str, Separation]:
    """Return what is compared, by its name; aligned paths are moved and turned to the other."""
    rows = {}
    for name, error in pair.errors.items():
        rows[f'{name} - truth{", aligned" if error.aligned else ""}'] = error
    for row in (pair.apart, pair.aligned):
        if row is not None:
            rows[f'estimate - {pair.topic}{", aligned" if row.aligned else ""}'] = row
    return rows


def _span(row: Separation) -> float:
    """Return the seconds from the first to the last time at which both are known."""
    return float(row.time[-1] - row.time[0]) if len(row.time) else nan


def _cell(value: float) -> str:
    return '' if value != value else f'{value:.3g}'


def sentences(run: Replayed, pair: Comparison) -> Iterator[str]:
    """Yield where two estimates part most and what happens there, and what is not compared."""
    ours = run.poses()
    few = ', which takes two poses' if len(pair.other.time) < 2 else ''
    if ours is None:
        other = pair.topic or 'the truth'
        yield f'There are no estimates with a pose to compare with {other}.'
        return
    if pair.apart is not None:
        yield _parting(run, pair, pair.apart, ours)
    elif run.against is not None:
        yield f'There is no time at which the estimate and {pair.topic} are both known{few}.'
    if run.reference() is not None:
        named = {'estimate': 'the estimate'}
        if run.against is not None:
            named[pair.topic] = pair.topic
        for key, name in named.items():
            if key not in pair.errors:
                yield f'There is no time at which {name} and the truth are both known.'
    read = {pair.topic: pair.other}
    if run.true_poses is not None and run.true_poses is not pair.other:
        read['the truth'] = run.true_poses
    for name, path in read.items():
        if path.skipped:
            yield (
                f'{path.skipped} messages of {name} are not compared: without a stamp, not '
                'finite, with a quaternion of zero, or in another frame than the first.'
            )


def _parting(run: Replayed, pair: Comparison, apart: Separation, ours: PosePath) -> str:
    """Return where two estimates part most, and what happens there."""
    at = int(np.argmax(apart.distance))
    sigma = _deviation(ours, float(apart.time[at]))
    sigmas = f' ({apart.distance[at] / sigma:.2g} sigma of the estimate)' if sigma > 0.0 else ''
    start, end = _growth(apart.time, apart.distance, at)
    once = ', once the one is moved and turned to the other,' if apart.aligned else ''
    return (
        f'They part most{once} at {apart.time[at]:.4g} s, by {apart.distance[at]:.3g} m{sigmas}; '
        f'they part fastest from {start:.4g} to {end:.4g} s: {_why(run, pair, ours, start, end)}.'
    )


def _deviation(path: PosePath, time: float) -> float:
    """Return the standard deviation of the position at a time, in metres; 0 if not known."""
    C = path.covariance
    if C is None:
        return 0.0
    index = min(int(np.searchsorted(path.time, time)), len(path.time) - 1)
    return float(np.sqrt(np.trace(C[index])))


def _growth(time: Array, distance: Array, last: int) -> tuple[float, float]:
    """Return the window before the largest distance in which the distance grows most."""
    width = max(_SHORTEST, _WINDOW * float(time[-1] - time[0]))
    starts = np.flatnonzero(time <= max(float(time[last]) - width, float(time[0])))
    ends = np.minimum(np.searchsorted(time, time[starts] + width), len(time) - 1)
    best = int(np.argmax(distance[ends] - distance[starts]))
    return float(time[starts[best]]), float(time[ends[best]])


def _why(run: Replayed, pair: Comparison, ours: PosePath, start: float, end: float) -> str:
    """Return what is unusual in a window, the most telling first."""
    apart = pair.apart
    assert apart is not None
    edges = np.interp((start, end), apart.time, apart.distance)
    grown = float(edges[1] - edges[0])
    for name, path in ((pair.topic, pair.other), ('the estimate', ours)):
        jump = _jump(path, start, end)
        if jump > _PART * max(grown, 1e-9):
            return f'{name} jumps by {jump:.3g} m'
    missing = _silence(pair.other.time, start, end)
    if missing > 0.0:
        return f'{pair.topic} has no poses for {missing:.3g} s'
    for name, sensor in run.sensors.items():
        inside = (sensor.stamp >= start) & (sensor.stamp <= end)
        refused = np.array(['REJECTED' in word or 'OUTVOTED' in word for word in sensor.outcome])
        if inside.any():
            share, usual = float(refused[inside].mean()), float(refused.mean())
            if share > _REJECTED and share > _MORE * usual:
                return f'{int(refused[inside].sum())} readings of {name} are rejected'
        quiet = _silence(sensor.stamp, start, end)
        if quiet > 0.0:
            return f'{name} has no readings for {quiet:.3g} s'
    both = [path.at(np.array([start, end])) for path in (ours, pair.other)]
    if not apart.aligned:
        turned = so3.to_euler(so3.compose(-both[1].rotation, both[0].rotation))[0, 2]
        if abs(turned) > _TURNED:
            return f'their headings differ by {abs(degrees(turned)):.3g} deg'
    ways = [_way(path, start, end) for path in (ours, pair.other)]
    if abs(ways[0] - ways[1]) > _FARTHER * max(ways):
        return f'the estimate goes {ways[0]:.3g} m, {pair.topic} {ways[1]:.3g} m'
    return 'no reading is missing or rejected; they weigh the same readings differently'


def _jump(path: PosePath, start: float, end: float) -> float:
    """Return the largest step within a window, if it is far faster than usual; else 0."""
    steps = np.linalg.norm(np.diff(path.position, axis=0), axis=1)
    speeds = steps / np.maximum(np.diff(path.time), 1e-3)
    inside = (path.time[1:] >= start) & (path.time[1:] <= end)
    if not inside.any():
        return 0.0
    at = int(np.argmax(np.where(inside, speeds, -1.0)))
    usual = float(np.quantile(speeds, 0.95))
    return float(steps[at]) if speeds[at] > _JUMP * max(usual, 1e-9) else 0.0


def _silence(stamps: Array, start: float, end: float) -> float:
    """Return the longest time without readings that overlaps a window, if unusual; else 0."""
    if len(stamps) < 3:
        return 0.0
    times = np.sort(stamps)
    gaps = np.diff(times)
    overlaps = (times[1:] > start) & (times[:-1] < end)
    longest = float(np.max(gaps[overlaps], initial=0.0))
    unusual = max(5.0 * float(np.median(gaps)), 0.5 * (end - start))
    return longest if longest > unusual else 0.0


def _way(path: PosePath, start: float, end: float) -> float:
    use = (path.time >= start) & (path.time <= end)
    steps = np.linalg.norm(np.diff(path.position[use], axis=0), axis=1)
    return float(steps.sum())


def summary(pair: Comparison) -> dict[str, Any]:
    """Return the comparison for ``summary.json``."""
    return {name: _json(row) for name, row in _rows(pair).items()}


def _json(row: Separation) -> dict[str, Any]:
    at = int(np.argmax(row.distance)) if len(row.distance) else 0
    return {
        'seconds': plain(_span(row)),
        'ate': plain(row.ate),
        'heading': plain(row.heading),
        'nees': plain(row.nees),
        'aligned': row.aligned,
        'relative': [
            {'length': part.length, 'position': plain(part.position),
             'rotation': plain(part.rotation), 'parts': part.count}
            for part in row.relative
        ],
        'largest': plain(float(row.distance[at])) if len(row.distance) else plain(nan),
        'largest_at': plain(float(row.time[at])) if len(row.time) else plain(nan),
    }  # fmt: skip
