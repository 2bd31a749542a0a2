# SPDX-License-Identifier: Apache-2.0
"""Errors of a sensor that wander, or are correlated in time: likelihood and path of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.compiled.recursions import Errors
from kalman_ros.core import Array

from .error_filter import ErrorFilter, errors_of
from .passage import Passage

#: Trial factors of the densities that a coarser fit found, from the middle outwards.
_STEP, _MOST = 4.0, 4
#: Pieces in whose means a path is judged; the largest share of its steps that those of the
#: readings explain, and the largest excess kurtosis of its steps.
_PIECES, _FOLLOWED, _JUMPS = 200, 0.5, 3.0
#: Variance at the start, in seconds of the walk.
_BEFORE = 1.0
#: Trial time constants of noise by the interval of the readings, the longest by the recording,
#: and the share of the variance that stays white, so that the readings have an inverse.
_TIMES, _SHARE, _WHITE = np.array([5.0, 30.0, 180.0, 1080.0]), 0.2, 0.01
#: Ratio of the first trial times to those between them.
_BETWEEN = 2.4
#: Trial shares of the covariance of noise that is smaller than declared, and how far an unknown
#: constant may be from zero, in declared standard deviations.
_SMALLER, _ANYWHERE = (0.3, 0.1, 0.03, 0.01, 1e-3), 10.0


def is_walk(times: Array, path: Array, predicted: Array) -> bool:
    """Return whether a path is a walk: Gaussian, and independent of the readings.

    Parameters
    ----------
    times, path
        Times (E,) of an offset (E, c).
    predicted
        Predicted readings (E, k) of the sensor.

    A wrong scale or an axis that reads another makes an offset of which most moves with the
    readings, and clusters of outliers make one that jumps.
    """
    pieces = max(2, min(_PIECES, len(times) // 5))
    edges = np.linspace(times[0], times[-1], pieces + 1)[1:-1]
    piece = np.searchsorted(edges, times)
    count = np.bincount(piece, minlength=pieces)
    kept = count > 0

    def steps(values: Array) -> Array:
        sums = [np.bincount(piece, column, minlength=pieces) for column in values.T]
        means = np.array(sums).T[kept] / count[kept][:, None]
        differences: Array = np.diff(means, axis=0)
        return np.asarray(differences - differences.mean(axis=0))

    moved, read = steps(path), steps(predicted)
    scale = moved.std(axis=0)
    if len(moved) <= 2 * read.shape[1] or not (scale > 0.0).all():
        return True
    jumps = np.mean((moved / scale) ** 4, axis=0) - 3.0
    left = moved - read @ np.linalg.lstsq(read, moved, rcond=None)[0]
    followed = 1.0 - left.var(axis=0) / moved.var(axis=0)
    return bool(followed.max() < _FOLLOWED and jumps.max() < _JUMPS)


class _Steps(NamedTuple):
    """The readings of a pass, and the error of the state and of a sensor, which they show.

    Parameters
    ----------
    errors
        Innovations of the pass, with the error of n states and of c numbers of the sensor, whose
        step is missing.
    dt, first
        Duration of the steps (E,), and the covariance of the state at the first event (n, n).
    events, rows
        Events of the sensor, and the rows of its readings.
    """

    errors: Errors
    dt: Array
    first: Array
    events: Any
    rows: Any


def _steps(passage: Passage, sensor: str, coordinates: Sequence[int]) -> _Steps:
    """Return the readings of a pass, with an error of some coordinates of a sensor."""
    k = passage.series('innovation', sensor).shape[1]
    errors = errors_of(passage, {sensor: np.eye(k)[:, list(coordinates)]})
    events = passage.of(sensor)
    return _Steps(
        errors, passage.series('dt'), passage.series('P')[0], events, passage.rows_of(sensor)
    )


def likeliest(
    passage: Passage, sensor: str, coordinates: Sequence[int], densities: Array
) -> tuple[float, Array]:
    """Return the reduction of the misfit by a walk, and the path that is drawn.

    Parameters
    ----------
    passage
        Pass without the walk.
    sensor, coordinates
        Those of the offset.
    densities
        Spectral density of each coordinate (c,), about which the likeliest is searched.

    Returns
    -------
    gain, path
        Path (E, c) at the events of the sensor.
    """
    steps = _steps(passage, sensor, coordinates)

    def walk(factor: float) -> ErrorFilter:
        return _filtered(steps, np.diag(factor * densities))

    factor, best = 1.0, walk(1.0)
    for by in (_STEP, 1.0 / _STEP):
        start = factor
        for _ in range(_MOST):
            other = walk(factor * by)
            if other.misfit >= best.misfit:
                break
            factor, best = factor * by, other
        if factor != start:  # it grows in one direction alone
            break
    return passage.misfit - best.misfit, best.path(steps.events)


def coloured(passage: Passage, sensor: str, covariance: Array) -> tuple[float, float, Array]:
    """Return how well noise that is correlated in time explains a pass.

    The noise of the sensor is then a Gauss-Markov process with its declared ``covariance`` (k, k),
    and a correlation that decays with a time constant. A small part of it is white.

    Returns
    -------
    gain, time, path
        Reduction of the misfit, time constant in s, and a path of the noise (E, k) at the events
        of the sensor, drawn given all readings.
    """
    stamps = passage.series('time', sensor)
    steps = _steps(passage, sensor, range(len(covariance)))

    def noise(time: float) -> ErrorFilter:
        return _filtered(steps, 2.0 / time * covariance, 1.0 / time, _WHITE)

    trials, longest = float(np.median(np.diff(stamps))) * _TIMES, _SHARE * np.ptp(stamps)
    tried = {time: noise(time) for time in trials.tolist() if time < longest}
    if not tried:
        return 0.0, 0.0, np.zeros((len(stamps), len(covariance)))
    middle = min(tried, key=lambda time: tried[time].misfit)
    between = (middle / _BETWEEN, middle * _BETWEEN)
    tried |= {time: noise(time) for time in between if min(trials) < time < longest}
    time, best = min(tried.items(), key=lambda item: item[1].misfit)
    return passage.misfit - best.misfit, time, best.path(steps.events)


def whiter(passage: Passage, sensor: str, covariance: Array) -> float:
    """Return the reduction of the misfit by smaller noise of a sensor, white about a constant.

    The constant is unknown: `_ANYWHERE` times as uncertain as a reading with the declared
    ``covariance`` (k, k).
    """
    steps, none = _steps(passage, sensor, range(len(covariance))), np.zeros(covariance.shape)
    tried = (_filtered(steps, none, 0.0, share, _ANYWHERE**2 * covariance) for share in _SMALLER)
    return passage.misfit - min(error.misfit for error in tried)


def _filtered(
    steps: _Steps,
    density: Array,
    decay: float = 0.0,
    white: float = 1.0,
    start: Array | None = None,
) -> ErrorFilter:
    """Return the filter of the error of a pass and of an error of a sensor.

    Parameters
    ----------
    steps
        Readings of the pass, without the error of the sensor.
    density
        Spectral density of the noise that drives the error (c, c).
    decay
        Rate at which the error decays, in 1/s; 0 for a random walk.
    white
        Share of the covariance of the readings that is white noise beside the error.
    start
        Covariance of the error at the start; by default what the density adds in a second, or
        that of its stationary distribution.
    """
    kept, added = _decayed(steps.dt, decay)
    n = len(steps.first)
    F, Q, R = steps.errors.F.copy(), steps.errors.Q.copy(), steps.errors.R.copy()
    offsets = n + np.arange(len(density))
    F[:, offsets, offsets] = kept[:, None]
    Q[:, n:, n:] = added[:, None, None] * density
    R[steps.rows] *= white
    before = _decayed(np.array([np.inf if decay else _BEFORE]), decay)[1][0]
    initial = before * density if start is None else start
    return ErrorFilter(steps.errors._replace(F=F, Q=Q, R=R), steps.first, initial)


def _decayed(dt: Array, decay: float) -> tuple[Array, Array]:
    """Return the shares of an error that are left after ``dt`` (E,), and its variance by density.

    The variance is that which noise of unit density adds in this time.
    """
    if not decay:
        return np.ones(dt.shape), dt
    left = np.exp(-decay * dt)
    return left, (1.0 - left * left) / (2.0 * decay)
