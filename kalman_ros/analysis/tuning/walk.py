# SPDX-License-Identifier: Apache-2.0
"""All candidates on their way through a recording at once, and their innovations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, Space, in_continuous_time, unchecked
from kalman_ros.core.candidates import candidate_model, candidate_sensor
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.start import match_reading

from .candidate import Candidate, Part, candidate_filter
from .earlier import SAFE, Earlier, corrected
from .observations import Event, Observations, Stamps

#: Innovations are handed over in blocks of N readings.
_BLOCK = 2000


@dataclass(frozen=True)
class Block:
    """Innovations of N readings of some coordinates of a sensor, for p candidates.

    Parameters
    ----------
    sensor, output
        Its name, and the space of the coordinates.
    time
        In nanoseconds (N,).
    innovation
        (N, p, k).
    covariance
        S (N, p, k, k).
    accepted
        Which the gates accepted (N, p).
    """

    sensor: str
    output: Space
    time: Stamps
    innovation: Array
    covariance: Array
    accepted: Any

    def split(self, q: int) -> Iterator[Block]:
        """Yield the parts of q sets of as many candidates."""
        sizes = (np.split(a, q, axis=1) for a in (self.innovation, self.covariance, self.accepted))
        for innovation, covariance, accepted in zip(*sizes):
            yield replace(self, innovation=innovation, covariance=covariance, accepted=accepted)


@dataclass(frozen=True)
class Conditions:
    """How an estimator takes readings.

    Parameters
    ----------
    policy
        Of its gates, its start, and gaps.
    input
        Until the first one (m,).
    """

    policy: Policy
    input: Array


class Walk:
    """The beliefs of p candidates through the events of a recording, in the order of stamps.

    Delays are those of the first candidate; what those of others differ by must be short.

    Parameters
    ----------
    observations
        The recording.
    conditions
        Of the estimator. A gate opens after as many rejections in a row as it recovers after.
    candidates
        All with filters of one kind.
    together
        Whether the gates of the first candidate decide for all.
    """

    def __init__(
        self,
        observations: Observations,
        conditions: Conditions,
        candidates: Sequence[Candidate],
        together: bool = False,
    ) -> None:
        self._observations, self._conditions = observations, conditions
        self._candidates, self._together = candidates, together
        self._filter = candidate_filter([each.filter for each in candidates])
        self._names = list(observations.readings)
        policy = conditions.policy
        self._gates = [(policy.gates or {}).get(name) for name in self._names]
        self._bias = [
            np.stack([c.biases.get(name, np.zeros(())) + np.zeros(self._width(name))
                      for c in candidates])
            for name in self._names
        ]  # fmt: skip
        self._sensors = [candidate_sensor([c.sensors[name] for c in candidates])
                         for name in self._names]  # fmt: skip
        delays = [np.array([c.delays.get(name, 0.0) for c in candidates]) for name in self._names]
        self._delayed = [each - each[0] for each in delays]
        moving = candidate_model([c.model for c in candidates]) if np.any(delays) else None
        self._earlier = [
            Earlier(sensor, in_continuous_time(moving))
            if moving is not None and each.any()
            else None
            for sensor, each in zip(self._sensors, delays)
        ]
        self._with: dict[tuple[int, bool, bytes, bytes], Sensor] = {}
        self._rejections = [0] * len(self._names)
        self._belief = self._first()
        self._fresh = True
        self._corrected = 0

    def _width(self, name: str) -> int:
        return int(self._observations.readings[name].value.shape[1])

    def _first(self) -> Gaussian:
        x = np.stack([each.initial.mean for each in self._candidates])
        P = np.stack([each.initial.covariance for each in self._candidates])
        return unchecked((x, P))

    def blocks(
        self, until: int | None = None, progress: Callable[[float], None] | None = None
    ) -> Iterator[Block]:
        """Yield the innovations of all readings up to the stamp ``until``.

        Raises
        ------
        ArithmeticError, numpy.linalg.LinAlgError
            If a candidate cannot be computed at all.
        """
        events = self._observations.events(self._candidates[0].delays, until)
        collected: _Collected = {}
        policy, u = self._conditions.policy, self._conditions.input
        moving = not policy.rest_until_input or not len(self._observations.input_stamp)
        longest = round(policy.max_gap * 1e9) or np.inf
        # a first belief that does not begin with a reading holds from the first stamp on, whatever
        # the delays: if it moved with them, they would be as uncertain as it is
        now = self._observations.first if events else 0
        if events and policy.from_reading:
            now = events[0].time
        self._corrected, taken = now, 0
        for event in events:
            if event.time > now:
                if event.time - now > longest:
                    self._belief, self._fresh = self._first(), True
                elif moving:
                    self._belief = self._filter.predict(self._belief, u, (event.time - now) * 1e-9)
                now = event.time
            if event.order == len(self._names):
                u, moving = self._observations.input[event.row], True
                continue
            # the first belief is corrected by readings from before it, too
            key, row = self._take(event, u, (now - event.time) * 1e-9)
            collected.setdefault(key, []).append((event.time, *row))
            taken += 1
            if taken % _BLOCK == 0:
                if progress is not None:
                    progress(taken / len(events))
                yield from self._handed(collected)
                collected = {}
        yield from self._handed(collected)

    def _take(
        self, event: Event, u: Array, late: float
    ) -> tuple[tuple[int, bytes], tuple[Any, ...]]:
        """Correct the beliefs by a reading that is ``late`` seconds earlier than they are.

        Return its key and its results.
        """
        order, index = event.order, event.row
        readings = self._observations.readings[self._names[order]]
        present = np.isfinite(readings.value[index])
        covariance = None if readings.covariance is None else readings.covariance[index]
        earlier = self._earlier[order]
        if not late and not self._delayed[order].any():
            earlier = None
        sensor = self._sensor(order, earlier, present, covariance)
        y = (readings.value[index] - self._bias[order])[:, present]
        if self._fresh:
            self._fresh = False
            if self._conditions.policy.from_reading:
                self._start(order, present, y)
        prior = self._belief
        if earlier is None:
            found = self._filter.correct(prior, y, sensor)
        else:
            earlier.set(self._delayed[order] + late, u)
            since = max((event.time - self._corrected) * 1e-9, SAFE)
            noise = earlier.noise_between(prior.mean, since)
            found = corrected(self._filter, prior, y, sensor, noise)
        self._corrected = event.time
        accepted: Any = True
        gate = self._gates[order]
        if gate is not None:
            accepted = found.nis <= gate
            if self._together:
                accepted = np.broadcast_to(accepted[0], accepted.shape)
            needed = self._conditions.policy.recover_after
            if needed and self._rejections[order] >= needed:
                accepted = np.ones_like(accepted)
            self._rejections[order] = 0 if accepted[0] else self._rejections[order] + 1
        self._belief = found.posterior
        if accepted is not True and not accepted.all():
            self._belief = _chosen(accepted, found.posterior, prior)
        return (order, present.tobytes()), (
            found.innovation, found.innovation_covariance, accepted,
        )  # fmt: skip

    def _sensor(
        self, order: int, earlier: Earlier | None, present: Array, covariance: Array | None
    ) -> Sensor:
        """Return a sensor with the coordinates that are ``present`` and the noise of a message."""
        base = earlier or self._sensors[order]
        if covariance is None and present.all():
            return base
        noise = b'' if covariance is None else covariance.tobytes()
        key = order, earlier is not None, present.tobytes(), noise
        found = self._with.get(key)
        if found is None:
            found = base
            if covariance is not None:
                found = found.with_covariance(covariance)
            if not present.all():
                found = Part(found, present)
            if len(self._with) > _BLOCK:
                self._with.clear()
            self._with[key] = found
        return found

    def _start(self, order: int, present: Array, y: Array) -> None:
        """Move the first beliefs to match the first reading, as the estimator does."""
        if not present.all():
            return
        x, P = self._belief
        moved = x.copy()
        for p, each in enumerate(self._candidates):
            sensor = each.sensors[self._names[order]]
            moved[p] = match_reading(Gaussian(x[p], P[p]), y[p], sensor).mean
        self._belief = unchecked((moved, P))

    def _handed(self, collected: _Collected) -> Iterator[Block]:
        p = len(self._candidates)
        for (order, present), columns in collected.items():
            name, use = self._names[order], np.frombuffer(present, dtype=bool)
            output = self._candidates[0].sensors[name].output
            if not use.all():
                output = output.select(np.array(output.names)[use].tolist())
            times, innovations, covariances, accepted = zip(*columns)
            k = int(use.sum())
            N = len(times)
            S = np.broadcast_to(np.array(covariances).reshape(N, -1, k, k), (N, p, k, k))
            E, A = np.array(innovations), np.array(accepted).reshape(N, -1)
            yield Block(
                name, output, np.array(times, dtype=np.int64), E, S, np.broadcast_to(A, (N, p))
            )


#: By sensor and coordinates: time, innovation, covariance and what was accepted, by reading.
_Collected = dict[tuple[int, bytes], list[tuple[Any, ...]]]


def _chosen(mask: Any, a: Gaussian, b: Gaussian) -> Gaussian:
    """Return beliefs ``a`` where the mask is set, and ``b`` elsewhere."""
    x = np.where(mask[:, np.newaxis], a.mean, b.mean)
    return unchecked((x, np.where(mask[:, np.newaxis, np.newaxis], a.covariance, b.covariance)))
