# SPDX-License-Identifier: Apache-2.0
"""Pass of an extended Kalman filter in the order of stamps, with the matrices of each step.

A replay has the results of the online estimator, which processes readings as they are received. A
pass has the results of a filter that processes the readings in order, and its linearisation, from
which the responses of innovations to faults are computed; see `responses`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
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
#: Normalised innovations are limited to this magnitude.
_FAR = 1e6
#: Normalised innovations beyond this are those of outliers.
_OUTLIER = 5.0
#: Normalised squares are limited to this value for the choice of an initial belief, since larger
#: squares are those of outliers.
_OUTLYING = 30.0


@dataclass(frozen=True, slots=True)
class Event:
    """A reading in a filter pass: the step that led to it, and its correction.

    Parameters
    ----------
    sensor, index
        Name of the sensor, and index of the reading in its record.
    time
        Stamp in seconds.
    F, Q, dt
        Transition matrix (n, n) from the previous event, its noise covariance (n, n), and its
        duration in seconds.
    x, P, u
        Prediction (n,), its covariance (n, n), and the input (m,) that led to it.
    H, K, S, innovation
        Jacobian of the sensor, gain, innovation covariance and innovation.
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
    """The events of a filter pass, with whitened innovations e = L^-1 nu where S = L L'."""

    events: list[Event]
    whitened: list[Array]

    @property
    def misfit(self) -> float:
        """Misfit of the pass, the sum of e'e + log |2 pi S|, which is -2 log likelihood."""
        squares = sum(float(e.dot(e)) for e in self.whitened)
        return squares + sum(event.log for event in self.events)

    @cached_property
    def mean_square(self) -> float:
        """Mean square of the whitened innovations, each up to 5 deviations; 1 is expected."""
        e = np.concatenate([np.zeros(0), *self.whitened])
        return float(np.mean(np.square(np.clip(e, -_OUTLIER, _OUTLIER)))) if len(e) else 1.0

    @cached_property
    def _indices(self) -> dict[str, list[int]]:
        by_sensor = defaultdict[str, list[int]](list)
        for index, event in enumerate(self.events):
            by_sensor[event.sensor].append(index)
        return by_sensor

    @cached_property
    def terms(self) -> dict[tuple[str, int], tuple[float, float, int]]:
        """Square e'e, log |2 pi S| and size of each reading, by sensor and index."""
        return {
            (event.sensor, event.index): (float(e.dot(e)), event.log, len(e))
            for event, e in zip(self.events, self.whitened)
        }

    def selected(self, sensor: str, rows: Any) -> Passage:
        """Return the pass over a record that is reduced to ``rows``, in this order.

        The rows must contain all events of the sensor.
        """
        index = {row: i for i, row in enumerate(rows.tolist())}
        events = [
            replace(event, index=index[event.index]) if event.sensor == sensor else event
            for event in self.events
        ]
        return Passage(events, self.whitened)

    def of(self, sensor: str) -> Array:
        """Return the indices of the events of a sensor."""
        return np.array(self._indices.get(sensor, []), dtype=int)

    def whitened_of(self, sensor: str) -> Array:
        """Return the whitened innovations of a sensor (E, k)."""
        return np.array([self.whitened[i] for i in self._indices.get(sensor, [])])

    def squares(self, sensor: str) -> Array:
        """Return the squares e'e of the whitened innovations of a sensor (E,)."""
        return np.array([e @ e for e in self.whitened_of(sensor)])


def passage(evidence: Evidence, until: float = inf, strict: bool = True) -> Passage:
    """Run an extended Kalman filter over the usable readings, up to a stamp (s).

    Duplicates and readings that are not `usable` are omitted.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the filter fails and the pass is ``strict``; otherwise the pass ends there.
    """
    events: list[Event] = []
    whitened: list[Array] = []
    try:
        for event, e in _run_filter(evidence, _initial_belief(evidence, until), until):
            events.append(event)
            whitened.append(e)
    except np.linalg.LinAlgError:
        if strict:
            raise
    return Passage(events, whitened)


def _initial_belief(evidence: Evidence, until: float) -> Gaussian:
    """Return the belief from which one filter can follow the readings, or the likeliest part.

    A pass over the first seconds starts at the whole belief, since such passes are many, and too
    short to choose a part.
    """
    scenario = evidence.scenario
    if not filter_class(scenario.filter).mixture or until < inf:
        return scenario.initial_belief

    def follow(part: Gaussian) -> Iterator[float]:
        for event, e in _run_filter(evidence, part, inf):
            yield min(float(e.dot(e)), _OUTLYING) + event.log

    return likeliest(scenario.initial_belief, scenario.model.state, follow)


def _run_filter(
    evidence: Evidence,
    first: Gaussian,
    until: float,
    gate: tuple[str, float, list[int]] | None = None,
) -> Iterator[tuple[Event, Array]]:
    """Yield the events of a pass from the ``first`` belief, and their whitened innovations.

    A ``gate`` (sensor, largest NIS, list) omits the readings beyond it, and appends their indices
    to the list.
    """
    scenario = computed(evidence.scenario)
    filter = ExtendedKalmanFilter(scenario.model)
    sensors = {name: source.sensor for name, source in scenario.sensors.items()}
    walk = Walk(filter, evidence, first)
    for time, name, index in _order_readings(evidence, until):
        F, Q, dt = walk.to(time)
        record, prior = evidence.sensors[name], walk.belief
        if not is_finite(prior.mean):
            raise np.linalg.LinAlgError('the estimate is not finite')
        sensor = sensors[name].with_covariance(record.covariance[index])
        correction: Any = filter.correct(prior, record.value[index], sensor)
        if gate and name == gate[0] and correction.nis > gate[1]:
            gate[2].append(index)
            walk.skip(F, Q, dt)
            continue
        walk.belief = correction.posterior
        nu, S, H, K = (
            correction.innovation,
            correction.innovation_covariance,
            correction.jacobian,
            correction.gain,
        )
        white, log_determinant = whitener(S)
        event = Event(
            name, index, time, F, Q, dt, *prior, walk.u, H, K, S, nu, white, log_determinant
        )
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


def rejected(evidence: Evidence, name: str, limit: float) -> Array:
    """Return the readings of a sensor, by index, that a gate at a NIS rejects."""
    indices: list[int] = []
    first = _initial_belief(evidence, inf)
    with suppress(np.linalg.LinAlgError):  # what is known until the filter fails
        for _ in _run_filter(evidence, first, inf, (name, limit, indices)):
            pass
    return np.array(indices, dtype=int)


def usable(record: SensorRecord) -> Any:
    """Return the mask (N,) of usable readings: finite, with a positive definite covariance."""
    finite: Any = np.isfinite(record.value).all(axis=1) & np.isfinite(record.stamp)
    sound: Any = np.isfinite(record.covariance).all(axis=(1, 2))
    lowest = np.linalg.eigvalsh(np.where(sound[:, None, None], record.covariance, 0.0))[:, 0]
    return finite & sound & (lowest > 0.0)


def _order_readings(evidence: Evidence, until: float) -> list[tuple[float, str, int]]:
    """Return the usable readings in the order of stamps, and of sensors for equal stamps."""
    readings = []
    for order, name in enumerate(evidence.scenario.enabled):
        record = evidence.sensors.get(name)
        if record is None or not len(record):
            continue
        indices = np.flatnonzero(usable(record) & (record.stamp <= until))
        stamps, first = np.unique(np.round(record.stamp[indices], 9), return_index=True)
        readings += [(t, order, name, int(indices[i])) for t, i in zip(stamps.tolist(), first)]
    return [(time, name, index) for time, _, name, index in sorted(readings)]


def explained(before: Passage, after: Passage) -> float:
    """Return the reduction of the misfit by a correction.

    A reading that the correction omits counts by the excess of its misfit over the expectation.
    """
    gain = 0.0
    for key, (square, log_size, k) in before.terms.items():
        if key in after.terms:
            gain += square + log_size - after.terms[key][0] - after.terms[key][1]
        else:
            gain += square - k - DROPPED
    return gain


#: Cost of the omission of a reading in -2 log likelihood, as of a reading at about 3 sigma.
DROPPED = 10.0
