# SPDX-License-Identifier: Apache-2.0
"""One pass of an extended Kalman filter in the order of stamps, with its linearisation kept.

The estimator's own replay has what it did; this has what a filter makes of the readings once
they are in order, and by which matrices: that is what the responses of innovations to faults are
computed from (`responses`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, log, pi
from typing import Any

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array, Gaussian, is_finite
from kalman_ros.estimators import filter_class
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.linear.single import whitening
from kalman_ros.simulation.computed import computed

from .beginning import likeliest
from .belief_walk import Walk
from .evidence import Evidence

LOG_2_PI = log(2.0 * pi)
#: Innovations beyond this many of their standard deviations count as this many.
_FAR = 1e6
#: Squares beyond this decide no more between first beliefs: they are those of outliers.
_OUTLYING = 30.0


@dataclass(frozen=True)
class Event:
    """A reading in its place: what led to it, and how it was taken in.

    Parameters
    ----------
    sensor, index
        Whose it is, and which of its record.
    time
        Its stamp in seconds.
    steps
        The transition F (n, n) from the event before, its Q (n, n), and its length in seconds.
    x, P, u
        The prediction (n,), its covariance (n, n), and the input (m,) that led to it.
    H, K, S, innovation
        The sensor's Jacobian, the gain (zero if it was not fused), innovation covariance and
        innovation.
    white, log
        L^-1 (k, k) with S = L L', and log |2 pi S|.
    """

    sensor: str
    index: int
    time: float
    F: Array
    Q: Array
    dt: float
    x: Array
    P: Array
    u: Array
    H: Array
    K: Array
    S: Array
    innovation: Array
    white: Array
    log: float


@dataclass(frozen=True)
class Passage:
    """All events in the order of stamps, and whitened innovations e = L^-1 nu with S = L L'."""

    events: list[Event]
    whitened: list[Array]

    @property
    def misfit(self) -> float:
        """The sum of e'e + log |2 pi S|, which is -2 log likelihood."""
        squares = sum(float(e.dot(e)) for e in self.whitened)
        return squares + sum(event.log for event in self.events)

    @cached_property
    def _indices(self) -> dict[str, list[int]]:
        found = defaultdict[str, list[int]](list)
        for index, event in enumerate(self.events):
            found[event.sensor].append(index)
        return found

    def selected(self, sensor: str, rows: Any) -> Passage:
        """Return the same pass over a record of which only these ``rows`` are left, in this order.

        They have to contain all events of the sensor.
        """
        index = {row: i for i, row in enumerate(rows.tolist())}
        events = [
            replace(event, index=index[event.index]) if event.sensor == sensor else event
            for event in self.events
        ]
        return Passage(events, self.whitened)

    def of(self, sensor: str) -> Array:
        """Return the indices of a sensor's events."""
        return np.array(self._indices.get(sensor, []), dtype=int)


def passage(
    evidence: Evidence,
    until: float = inf,
    gate: tuple[str, float, list[int]] | None = None,
    strict: bool = True,
) -> Passage:
    """Return what an extended filter makes of the usable readings, up to a stamp (s).

    Duplicates and what is not `usable` are left out. A ``gate`` (sensor, largest NIS, list) leaves
    out what is beyond it, and lists the indices.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the filter fails; unless it is ``strict``, the pass ends there instead.
    """
    events: list[Event] = []
    whitened: list[Array] = []
    try:
        for event, e in _followed(evidence, _first(evidence, until), until, gate):
            events.append(event)
            whitened.append(e)
    except np.linalg.LinAlgError:
        if strict:
            raise
    return Passage(events, whitened)


def _first(evidence: Evidence, until: float) -> Gaussian:
    """Return the belief from which one filter can follow the readings: if it must, a part.

    Passes through the first seconds alone are many, and too short to choose one.
    """
    scenario = evidence.scenario
    if not filter_class(scenario.filter).mixture or until < inf:
        return scenario.initial_belief

    def follow(part: Gaussian) -> Iterator[float]:
        for event, e in _followed(evidence, part, inf):
            yield min(float(e.dot(e)), _OUTLYING) + event.log

    return likeliest(scenario.initial_belief, scenario.model.state, follow)


def _followed(
    evidence: Evidence,
    first: Gaussian,
    until: float,
    gate: tuple[str, float, list[int]] | None = None,
) -> Iterator[tuple[Event, Array]]:
    """Yield the events of a pass from the ``first`` belief, and their whitened innovations."""
    scenario = computed(evidence.scenario)
    filter = ExtendedKalmanFilter(scenario.model)
    sensors = {name: source.sensor for name, source in scenario.sensors.items()}
    walk = Walk(filter, evidence, first)
    for time, name, index in _in_order(evidence, until):
        F, Q, dt = walk.to(time)
        record, prior = evidence.sensors[name], walk.belief
        if not is_finite(prior.mean):
            raise np.linalg.LinAlgError('the estimate is not finite')
        sensor = sensors[name].with_covariance(record.covariance[index])
        found: Any = filter.correct(prior, record.value[index], sensor)
        if gate and name == gate[0] and found.nis > gate[1]:
            gate[2].append(index)
            walk.skip(F, Q, dt)
            continue
        walk.belief = found.posterior
        nu, S, H, K = found.innovation, found.innovation_covariance, found.jacobian, found.gain
        white, size = whitener(S)
        event = Event(name, index, time, F, Q, dt, *prior, walk.u, H, K, S, nu, white, size)
        yield event, np.minimum(np.maximum(white.dot(nu), -_FAR), _FAR)


def whitener(S: Array) -> tuple[Array, float]:
    """Return L^-1 (k, k) with S = L L', and log |2 pi S|.

    Raises
    ------
    numpy.linalg.LinAlgError
        If S is not positive definite.
    """
    if len(S) == 1 and S[0, 0] > 0.0:
        return S**-0.5, LOG_2_PI + log(S[0, 0])
    white = whitening(S)
    return white, len(S) * LOG_2_PI - 2.0 * sum(map(log, white.diagonal().tolist()))


def gated(evidence: Evidence, name: str, limit: float) -> tuple[Array, Passage]:
    """Return the readings of a sensor that a gate rejects, at this NIS, and the pass without."""
    far: list[int] = []
    found = passage(evidence, gate=(name, limit, far), strict=False)
    return np.array(far, dtype=int), found


def usable(record: SensorRecord) -> Any:
    """Return the mask (N,) of the readings that a filter can take: finite, with a covariance."""
    finite: Any = np.isfinite(record.value).all(axis=1) & np.isfinite(record.stamp)
    sound: Any = np.isfinite(record.covariance).all(axis=(1, 2))
    lowest = np.linalg.eigvalsh(np.where(sound[:, None, None], record.covariance, 0.0))[:, 0]
    return finite & sound & (lowest > 0.0)


def _in_order(evidence: Evidence, until: float) -> list[tuple[float, str, int]]:
    """Return the usable readings by stamp, those of one stamp in the order of the sensors."""
    found = []
    for order, name in enumerate(evidence.scenario.enabled):
        record = evidence.sensors.get(name)
        if record is None or not len(record):
            continue
        indices = np.flatnonzero(usable(record) & (record.stamp <= until))
        stamps, first = np.unique(np.round(record.stamp[indices], 9), return_index=True)
        found += [(t, order, name, int(indices[i])) for t, i in zip(stamps.tolist(), first)]
    return [(time, name, index) for time, _, name, index in sorted(found)]


def explained(before: Passage, after: Passage) -> float:
    """Return by how much the misfit is smaller after a correction.

    Readings that were left out by it count as far as they were worse than expected.
    """

    def each(found: Passage) -> dict[tuple[str, int], tuple[float, float, int]]:
        terms = {}
        for event, e in zip(found.events, found.whitened):
            terms[event.sensor, event.index] = (float(e.dot(e)), event.log, len(e))
        return terms

    first, second = each(before), each(after)
    gain = 0.0
    for key, (square, size, k) in first.items():
        if key in second:
            gain += square + size - second[key][0] - second[key][1]
        else:
            gain += square - k - DROPPED
    return gain


#: What it costs to leave a reading out, in -2 log likelihood: as one at some 3 sigma.
DROPPED = 10.0
