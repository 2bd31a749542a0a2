# SPDX-License-Identifier: Apache-2.0
"""The likelihood of an error of a sensor that wanders, and a path of it, exact on a pass.

The offset joins the state of the linearised pass, with the state's error about the predictions
of the pass: after each event the pass moves its estimate by K nu, and the error by as much the
other way. The likelihood is that of the innovations of this larger filter (F. Schweppe, Evaluation
of Likelihood Functions for Gaussian Signals, IEEE Trans. Information Theory 11(1), 1965). A path
is drawn backwards from the filter's beliefs (S. Fruehwirth-Schnatter, Data Augmentation and
Dynamic Linear Models, J. Time Series Analysis 15(2), 1994): readings less the mean path would
scatter less than their noise, and less a drawn one they scatter as they should.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear import single
from kalman_ros.linear.matrices import symmetric

from .passage import Event, Passage, whitener

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
#: Seed of the drawn path: the same recording has the same diagnosis.
_SEED = 1
#: Share of a variance that is added, so that what is known exactly has an inverse.
_NUGGET = 1e-9


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
        found: Array = np.diff(means, axis=0)
        return np.asarray(found - found.mean(axis=0))

    moved, read = steps(path), steps(predicted)
    scale = moved.std(axis=0)
    if len(moved) <= 2 * read.shape[1] or not (scale > 0.0).all():
        return True
    jumps = np.mean((moved / scale) ** 4, axis=0) - 3.0
    left = moved - read @ np.linalg.lstsq(read, moved, rcond=None)[0]
    followed = 1.0 - left.var(axis=0) / moved.var(axis=0)
    return bool(followed.max() < _FOLLOWED and jumps.max() < _JUMPS)


class _Step(NamedTuple):
    """A linear step (F, Q) from the belief after an event to the prediction of the next one."""

    F: Array
    Q: Array
    mean: Array
    covariance: Array


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

    def walk(factor: float) -> _Error:
        return _Error(passage, sensor, coordinates, np.diag(factor * densities))

    factor, best = 1.0, walk(1.0)
    for step in (_STEP, 1.0 / _STEP):
        start = factor
        for _ in range(_MOST):
            other = walk(factor * step)
            if other.misfit >= best.misfit:
                break
            factor, best = factor * step, other
        if factor != start:  # it grows in one direction alone
            break
    return passage.misfit - best.misfit, best.path()


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
    coordinates = range(len(covariance))

    def noise(time: float) -> _Error:
        density = 2.0 / time * covariance
        return _Error(passage, sensor, coordinates, density, 1.0 / time, _WHITE)

    trials, longest = float(np.median(np.diff(stamps))) * _TIMES, _SHARE * np.ptp(stamps)
    tried = {time: noise(time) for time in trials.tolist() if time < longest}
    if not tried:
        return 0.0, 0.0, np.zeros((len(stamps), len(covariance)))
    middle = min(tried, key=lambda time: tried[time].misfit)
    between = (middle / _BETWEEN, middle * _BETWEEN)
    tried |= {time: noise(time) for time in between if min(trials) < time < longest}
    time, best = min(tried.items(), key=lambda item: item[1].misfit)
    return passage.misfit - best.misfit, time, best.path()


def whiter(passage: Passage, sensor: str, covariance: Array) -> float:
    """Return the reduction of the misfit by smaller noise of a sensor, white about a constant.

    The constant is unknown: `_ANYWHERE` times as uncertain as a reading with the declared
    ``covariance`` (k, k).
    """
    coordinates, none = range(len(covariance)), np.zeros(covariance.shape)
    tried = (
        _Error(passage, sensor, coordinates, none, 0.0, share, _ANYWHERE**2 * covariance)
        for share in _SMALLER
    )
    return passage.misfit - min(error.misfit for error in tried)


class _Error:
    """A filter of the error of the pass and of an error of a sensor.

    Parameters
    ----------
    passage, sensor, coordinates
        Pass without the error, and the coordinates with one (c,).
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

    def __init__(
        self,
        passage: Passage,
        sensor: str,
        coordinates: Sequence[int],
        density: Array,
        decay: float = 0.0,
        white: float = 1.0,
        start: Array | None = None,
    ) -> None:
        self._passage, self._sensor, self._coordinates = passage, sensor, list(coordinates)
        self._density, self._decay, self._white = density, decay, white
        _, first = self._step(np.inf if decay else _BEFORE)
        self._start = first if start is None else start
        self._n = len(passage.events[0].x)
        self.misfit = sum(misfit for misfit, _, _ in self._filter())

    def _step(self, dt: float) -> tuple[float, Array]:
        """Return the share of the error that is left after ``dt``, and the covariance added."""
        if not self._decay:
            return 1.0, dt * self._density
        left = float(np.exp(-self._decay * dt))
        return left, (1.0 - left * left) / (2.0 * self._decay) * self._density

    def _filter(self) -> Iterator[tuple[float, Array, Array]]:
        """Yield the misfit of each event, and the mean and covariance after it."""
        events, n, c = self._passage.events, self._n, len(self._coordinates)
        offsets = n + np.arange(c)
        m, P = np.zeros(n + c), np.zeros((n + c, n + c))
        P[:n, :n], P[n:, n:] = events[0].P, self._start
        for event, after in zip(events, [*events[1:], events[-1]]):
            H, R = np.zeros((len(event.innovation), n + c)), event.R
            H[:, :n] = event.H
            if event.sensor == self._sensor:
                H[self._coordinates, offsets] = 1.0
                R = self._white * R
            PH = P.dot(H.T)
            white, log_size = whitener(H.dot(PH) + R)
            e = white.dot(event.innovation - H.dot(m))
            gain = PH.dot(white.T)
            m, P = m + gain.dot(e), P - gain.dot(gain.T)
            yield float(e.dot(e)) + log_size, m, P
            _, _, m, P = self._between(event, after, m, P)

    def _between(self, event: Event, after: Event, m: Array, P: Array) -> _Step:
        """Return the step from the belief after an event to the event ``after`` it."""
        n, size = self._n, len(m)
        F, Q = np.zeros((2, size, size))
        F[:n, :n], Q[:n, :n] = after.F, after.Q
        share, Q[n:, n:] = self._step(after.dt)
        F.flat[n * (size + 1) :: size + 1] = share
        moved = m.copy()
        moved[:n] -= event.K.dot(event.innovation)
        return _Step(F, Q, F.dot(moved), symmetric(F.dot(P).dot(F.T) + Q))

    def path(self) -> Array:
        """Return a path (E, c) at the events of the sensor, drawn given all readings."""
        rng, n, events = np.random.default_rng(_SEED), self._n, self._passage.events
        beliefs = [(m, P) for _, m, P in self._filter()]
        drawn = _draw(rng, *beliefs[-1])
        offsets = [drawn[n:]]
        for index in reversed(range(len(events) - 1)):
            m, P = beliefs[index]
            step = self._between(events[index], events[index + 1], m, P)
            back = _solved(step.covariance, step.F @ P).T
            # Joseph's form, in which nothing cancels
            left = np.eye(len(m)) - back @ step.F
            covariance = left @ P @ left.T + back @ step.Q @ back.T
            drawn = _draw(rng, m + back @ (drawn - step.mean), covariance)
            offsets.append(drawn[n:])
        whole: Array = np.array(offsets[::-1])
        return np.asarray(whole[self._passage.of(self._sensor)])


def _solved(P: Array, right: Array) -> Array:
    """Return P^-1 times ``right``; a state may be known exactly."""
    scale, scaled = _scaled(P)
    divided: Array = single.divided(right / scale[:, None], scaled)
    return np.asarray(divided.T / scale[:, None])


def _draw(rng: np.random.Generator, mean: Array, covariance: Array) -> Array:
    scale, scaled = _scaled(covariance)
    root = single.repaired_factor(scaled)
    return np.asarray(mean + scale * root.dot(rng.standard_normal(len(mean))))


def _scaled(covariance: Array) -> tuple[Array, Array]:
    """Return deviations (n,), and correlations (n, n) that have an inverse."""
    scale = np.sqrt(np.maximum(covariance.diagonal(), 1e-300))
    correlation = symmetric(covariance) / (scale[:, None] * scale)
    correlation.flat[:: len(scale) + 1] += _NUGGET
    return scale, correlation
