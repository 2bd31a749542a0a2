# SPDX-License-Identifier: Apache-2.0
"""One filter pass of many candidates through a recording, and their innovations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, chosen, in_continuous_time, unchecked
from kalman_ros.core.candidates import candidate_model, candidate_sensor
from kalman_ros.estimators.diffuse import Diffuse, begun
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.start import likeliest, match_reading, rested

from .block import Block
from .candidate import Candidate, Part, candidate_filter
from .compiled_steps import CompiledSteps
from .earlier import SAFE, Earlier, corrected, noisier
from .observations import Event, Observations

#: Innovations are released in blocks of this number of readings and inputs.
_BLOCK = 2000


@dataclass(frozen=True)
class Conditions:
    """The conditions under which an estimator processes readings.

    Parameters
    ----------
    policy
        Policy for gates, start and gaps.
    input
        Input (m,) that holds until the first recorded input.
    """

    policy: Policy
    input: Array


class Walk:
    """A pass of the filters of p candidates through a recording, in the order of stamps.

    The readings are ordered by the delays of the first candidate. The delays of the other
    candidates may differ by short times only.

    Parameters
    ----------
    observations
        Recording.
    conditions
        Conditions of the estimator. A gate opens after the number of consecutive rejections that
        the policy specifies.
    candidates
        Candidates, all with filters of one kind.
    together
        Whether the gates of the first candidate decide for all candidates.
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
        self._filter = candidate_filter([candidate.filter for candidate in candidates])
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
        self._delayed = [column - column[0] for column in delays]
        moving = candidate_model([c.model for c in candidates]) if np.any(delays) else None
        self._earlier = [
            Earlier(sensor, in_continuous_time(moving))
            if moving is not None and delay.any()
            else None
            for sensor, delay in zip(self._sensors, delays)
        ]
        self._sensors_by_key: dict[tuple[int, bool, bytes, bytes], Sensor] = {}
        self._rejections = [0] * len(self._names)
        plain = not (any(self._gates) or any(self._earlier)) and CompiledSteps.suit(candidates)
        self._compiled = CompiledSteps(observations, candidates) if plain else None
        self._belief = self._initial_belief()
        self._started: set[int] = set()
        self._corrected = self._now = self._first = 0
        self._input, self._moving = conditions.input, True

    def _width(self, name: str) -> int:
        return int(self._observations.readings[name].value.shape[1])

    def _initial_belief(self) -> Gaussian:
        x = np.stack([candidate.initial.mean for candidate in self._candidates])
        P = np.stack([candidate.initial.covariance for candidate in self._candidates])
        return begun(unchecked((x, P)))

    def blocks(
        self, until: int | None = None, progress: Callable[[float], None] | None = None
    ) -> Iterator[Block]:
        """Yield the innovations of all readings up to the stamp ``until``.

        Raises
        ------
        ArithmeticError, numpy.linalg.LinAlgError
            If the filter of a candidate fails.
        """
        events = self._observations.events(self._candidates[0].delays, until)
        policy, self._input = self._conditions.policy, self._conditions.input
        self._moving = not policy.rest_until_input or not len(self._observations.input_stamp)
        # an initial belief that does not begin with a reading holds from the first stamp on, for
        # any delay: if it moved with the delays, they would be as uncertain as the belief
        self._now = self._observations.first if events else 0
        if events and policy.from_reading:
            self._now = events[0].time
        self._corrected = self._first = self._now
        for first in range(0, len(events), _BLOCK):
            if first and progress is not None:
                progress(first / len(events))
            some = events[first : first + _BLOCK]
            at_once = self._process_at_once(some)
            yield from self._process_in_turn(some) if at_once is None else at_once

    def _are_plain(self, events: Any) -> bool:
        """Return whether events (S, 3) need nothing but steps."""
        policy, names = self._conditions.policy, self._names
        if not self._moving or isinstance(self._belief, Diffuse):
            return False
        if (policy.from_reading or policy.from_rest) and len(self._started) < len(names):
            return False
        acts = bool((events[:, 1] == len(names)).any())
        if policy.from_rest and acts and self._input is self._conditions.input:
            return False  # the first input tells where a state rests
        return bool(np.diff(events[:, 0], prepend=self._now).max() <= self._longest)

    def _process_at_once(self, events: Sequence[Event]) -> list[Block] | None:
        """Return the blocks of events; None if they are not plain, or a step fails."""
        columns = np.array(events, dtype=np.int64)
        if self._compiled is None or not self._are_plain(columns):
            return None
        outcome = self._compiled(self._belief, self._now, columns, self._input)
        if outcome is None:
            return None
        self._belief, blocks = outcome
        self._now = self._corrected = max(self._now, events[-1].time)
        rows = columns[columns[:, 1] == len(self._names), 2]
        if len(rows):
            self._input = self._observations.input[rows[-1]]
        return blocks

    @property
    def _longest(self) -> float:
        """Length in nanoseconds of the longest gap over which a belief is kept."""
        return round(self._conditions.policy.max_gap * 1e9) or np.inf

    def _process_in_turn(self, events: Sequence[Event]) -> Iterator[Block]:
        """Yield the blocks of events."""
        collected: _Collected = {}
        policy, longest = self._conditions.policy, self._longest
        for event in events:
            if event.time > self._now:
                if event.time - self._now > longest:
                    self._belief = self._initial_belief()
                    self._started.clear()
                elif self._moving:
                    dt = (event.time - self._now) * 1e-9
                    self._belief = self._filter.predict(self._belief, self._input, dt)
                self._now = event.time
            if event.order == len(self._names):
                if policy.from_rest and self._input is self._conditions.input:
                    self._rest(self._observations.input[event.row])
                self._input, self._moving = self._observations.input[event.row], True
                continue
            # readings from before the initial belief correct it, too
            delay = (self._now - event.time) * 1e-9
            key, results = self._process_reading(event, self._input, delay)
            collected.setdefault(key, []).append((event.time, *results))
        yield from self._release_blocks(collected)

    def _process_reading(
        self, event: Event, u: Array, delay: float
    ) -> tuple[tuple[int, bytes], tuple[Any, ...]]:
        """Correct the beliefs by a reading that is ``delay`` seconds earlier than they are.

        Return the key of the block to which the reading belongs, and its results.
        """
        order, row = event.order, event.row
        readings = self._observations.readings[self._names[order]]
        present = np.isfinite(readings.value[row])
        covariance = None if readings.covariance is None else readings.covariance[row]
        earlier = self._earlier[order]
        if not delay and not self._delayed[order].any():
            earlier = None
        sensor = self._sensor_for(order, earlier, present, covariance)
        y = (readings.value[row] - self._bias[order])[:, present]
        self._start(order, present, y)
        prior = self._belief
        if earlier is None:
            correction = self._filter.correct(prior, y, sensor)
        else:
            earlier.set(self._delayed[order] + delay, u)
            elapsed = max((event.time - self._corrected) * 1e-9, SAFE)
            if event.time < self._first:
                before = noisier(sensor, prior.mean, earlier.noise_between(prior.mean, np.inf))
                correction = self._filter.correct(prior, y, before)
            else:
                noise = earlier.noise_between(prior.mean, elapsed)
                correction = corrected(self._filter, prior, y, sensor, noise)
        self._corrected = max(self._corrected, event.time)
        accepted: Any = True
        gate = self._gates[order]
        if gate is not None:
            accepted = correction.nis <= gate
            if self._together:
                accepted = np.broadcast_to(accepted[0], accepted.shape)
            recover_after = self._conditions.policy.recover_after
            if recover_after and self._rejections[order] >= recover_after:
                accepted = np.ones_like(accepted)
            self._rejections[order] = 0 if accepted[0] else self._rejections[order] + 1
        self._belief = correction.posterior
        if isinstance(prior, Diffuse):  # what nothing was known of cannot be far away
            accepted = True
        if accepted is not True and not accepted.all():
            self._belief = chosen(accepted, correction.posterior, prior)
        return (order, present.tobytes()), (
            correction.innovation, correction.innovation_covariance, accepted,
        )  # fmt: skip

    def _sensor_for(
        self, order: int, earlier: Earlier | None, present: Array, covariance: Array | None
    ) -> Sensor:
        """Return a sensor with the ``present`` coordinates and the covariance of a message."""
        base = earlier or self._sensors[order]
        if covariance is None and present.all():
            return base
        noise = b'' if covariance is None else covariance.tobytes()
        key = order, earlier is not None, present.tobytes(), noise
        sensor = self._sensors_by_key.get(key)
        if sensor is None:
            sensor = base
            if covariance is not None:
                sensor = sensor.with_covariance(covariance)
            if not present.all():
                sensor = Part(sensor, present)
            if len(self._sensors_by_key) > _BLOCK:
                self._sensors_by_key.clear()
            self._sensors_by_key[key] = sensor
        return sensor

    def _start(self, order: int, present: Array, y: Array) -> None:
        """Move the initial beliefs by a first reading, as the estimator does."""
        policy, first = self._conditions.policy, not self._started
        new = order not in self._started
        self._started.add(order)
        moves = (policy.from_reading and first) or (policy.from_rest and new)
        if not moves or isinstance(self._belief, Diffuse) or not present.all():
            return
        x, P = self._belief
        moved = x.copy()
        for p, candidate in enumerate(self._candidates):
            sensor, belief = candidate.sensors[self._names[order]], Gaussian(x[p], P[p])
            moved[p] = (
                match_reading(belief, y[p], sensor)
                if policy.from_reading
                else likeliest(belief, y[p], sensor, candidate.model)
            ).mean
        self._belief = unchecked((moved, P))

    def _rest(self, u: Array) -> None:
        """Let the initial beliefs be those of states that do not change under the first input."""
        if isinstance(self._belief, Diffuse):
            return
        x, P = self._belief
        beliefs = [
            rested(Gaussian(x[p], P[p]), u, candidate.model)
            for p, candidate in enumerate(self._candidates)
        ]
        self._belief = unchecked((
            np.stack([belief.mean for belief in beliefs]),
            np.stack([belief.covariance for belief in beliefs]),
        ))  # fmt: skip

    def _release_blocks(self, collected: _Collected) -> Iterator[Block]:
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


#: Time, innovation, covariance and acceptance of each reading, by sensor and coordinates.
_Collected = dict[tuple[int, bytes], list[tuple[Any, ...]]]
