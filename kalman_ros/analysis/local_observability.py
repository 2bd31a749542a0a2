# SPDX-License-Identifier: Apache-2.0
"""Observability of the state from recent readings alone, without the initial belief."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf

import numpy as np

from kalman_ros.core import Array, Dynamics, Sensor, is_finite, solve, symmetric
from kalman_ros.estimators.plan import parts
from kalman_ros.linear.structure import Observability
from kalman_ros.scenario import Scenario

from .observability import observability

#: The path covers the last N readings of the slowest sensor. It ends earlier where the current
#: state changes by this multiple of the initial uncertainty.
_PIECES, _MOST_GROWTH = 20, 1e3
#: Most steps of a path, which bounds the time that it takes: some milliseconds where the model is
#: compiled, ten times as long in numpy.
_STEPS = 100
#: Information below this share of the information of the initial belief is rounding.
_NONE = 1e-6
#: Standard deviation, in the unit of a state, up to which it counts as known exactly.
_EXACT = 1e-3


@dataclass
class _Piece:
    """A piece of the path: start and end (ns), number of readings, and integral of the input."""

    start: int
    end: int
    impulse: Array
    readings: Counter[str] = field(default_factory=Counter)

    @property
    def seconds(self) -> float:
        return (self.end - self.start) * 1e-9


@dataclass(frozen=True)
class LocalObservability:
    """The standard deviation (n,) of each state from readings alone, and the observability.

    A state is observed if its standard deviation does not exceed that of the initial belief.
    """

    std: Array
    verdict: Observability


def readings_alone(gramian: Array, first: Array) -> Array:
    """Return the standard deviation (n,) of each state from readings alone.

    Parameters
    ----------
    gramian
        Information of the readings (n, n), the sum of H' R^-1 H.
    first
        Standard deviations of the initial belief (n,), the scale on which small information is
        rounding. The scale of a state that is known exactly, or not at all, is its unit.
    """
    scales = _scales(first)
    size, directions = np.linalg.eigh(scales * symmetric(gramian) * scales[:, None])
    variance = np.array([1.0 / s if s > _NONE else inf for s in size.tolist()])
    components = np.where(np.abs(directions) > _NONE, variance, 0.0) * directions**2
    return np.asarray(scales * np.sqrt(components.sum(axis=1)))


def _scales(first: Array) -> Array:
    return np.where((first > _EXACT) & np.isfinite(first), first, 1.0)


class ObservabilityMeter:
    """A recorder of recent readings and inputs that evaluates the observability of the state.

    The Gramian of the readings with respect to the current state x,

        M = sum of (H dx_k/dx)' R^-1 (H dx_k/dx),

    is the inverse of the covariance of an estimate from the readings alone (R. Hermann and
    A. Krener, Nonlinear Controllability and Observability, IEEE Trans. Automatic Control 22(5),
    1977, for the rank). The linearisation follows one path, which leads back from the current
    estimate with the recorded inputs. If M were linearised about the estimate of each time, which
    every reading moves, it would count unobservable states as observed (G. Huang, A. Mourikis and
    S. Roumeliotis, Observability-based Rules for Designing Consistent EKF SLAM Estimators, Int. J.
    Robotics Research 29(5), 2010).

    The observability of a linear scenario is constant and needs no record. A discrete-time model
    cannot be integrated backwards, so it is linearised about the initial belief.

    Parameters
    ----------
    scenario
        The states and their first belief, and the rates of the sensors.
    model, sensors
        What computes these, as a filter does: compiled, and with biases as further states, which
        are taken for known. The scenario's by default.
    """

    def __init__(
        self,
        scenario: Scenario,
        model: Dynamics | None = None,
        sensors: Mapping[str, Sensor] | None = None,
    ) -> None:
        self._pieces: deque[_Piece] = deque(maxlen=_PIECES)
        self.configure(scenario, model, sensors)

    def configure(
        self,
        scenario: Scenario,
        model: Dynamics | None = None,
        sensors: Mapping[str, Sensor] | None = None,
    ) -> None:
        """Use another model or other sensors, and clear the path."""
        self._scenario, self._model = scenario, model or scenario.model
        self._sensors = sensors or {name: s.sensor for name, s in scenario.sensors.items()}
        constant = scenario.plan.linear or scenario.model.is_discrete
        self._linear = observability(scenario) if constant else None
        slowest = min((s.timed.rate for s in scenario.enabled.values()), default=inf)
        self._length = 1e9 / slowest
        self.reset()

    def reset(self) -> None:
        """Clear the path."""
        self._pieces.clear()
        self._zero: Array = np.zeros(self._scenario.model.input.size)
        self._u: Array = self._zero

    def input(self, time: int, u: Array) -> None:
        """Record the input (m,) that holds from a time in nanoseconds on."""
        if self._linear is None:
            self._piece_at(time)
            self._u = u

    def reading(self, name: str, time: int) -> None:
        """Record a reading of a sensor that was used, with its time in nanoseconds."""
        if self._linear is None:
            self._piece_at(time).readings[name] += 1

    def _piece_at(self, time: int) -> _Piece:
        """Return the piece at ``time``, with the input integrated until then."""
        if not self._pieces or time < self._pieces[0].start:  # no path yet, or the clock went back
            self.reset()
            self._pieces.append(_Piece(time, time, self._zero))
        piece = self._pieces[-1]
        if time > piece.end:
            if piece.end - piece.start >= self._length:
                piece = _Piece(piece.end, piece.end, self._zero)
                self._pieces.append(piece)
            if self._u is not self._zero:
                piece.impulse = piece.impulse + (time - piece.end) * 1e-9 * self._u
            piece.end = time
        return piece

    def report(self, x: Array) -> dict[str, str]:
        """Return the observability and the standard deviations from readings alone, as text."""
        if self._linear is not None:
            return {'observability': str(self._linear)}
        result, space = self(x), self._scenario.model.state
        deviations = zip(space.names, space.units, result.std.tolist())
        listed = ', '.join(f'{name} {std:.3g} {unit}'.rstrip() for name, unit, std in deviations)
        return {'observability': str(result.verdict), 'latest readings alone, 1 sigma': listed}

    def __call__(self, x: Array) -> LocalObservability:
        """Return the observability about the current estimate ``x`` of the model's states."""
        first = self._scenario.initial_belief.std
        std = readings_alone(self._gramian(x), first)
        return LocalObservability(std, self._classify(std, first))

    def _classify(self, std: Array, first: Array) -> Observability:
        names = self._scenario.model.state.names
        limits = _scales(first)
        observed = tuple(name for name, s, limit in zip(names, std, limits) if s <= limit)
        unobserved = tuple(name for name in names if name not in observed)
        return Observability(observed, unobserved, (), not unobserved)

    def _gramian(self, x: Array) -> Array:
        """Return the Gramian of the path that leads back from ``x``, as far as that is finite."""
        n = self._scenario.model.state.size
        M = np.zeros((n, n))
        with np.errstate(all='ignore'), suppress(np.linalg.LinAlgError):
            for more in self._readings(x):
                if not is_finite(more):
                    break
                M = M + more
        return M

    def _readings(self, x: Array) -> Iterator[Array]:
        """Yield the information of readings on the way back from ``x``, the latest first."""
        model, scales = self._model, _scales(self._scenario.initial_belief.std)
        n, most = scales.size, _STEPS // max(1, len(self._pieces))
        sensitivity = np.eye(n)
        for piece in reversed(self._pieces):
            for name, count in piece.readings.items():
                sensor = self._sensors[name]
                H = sensor.jacobian(x)[:, :n] @ sensitivity
                yield count * H.T @ solve(sensor.covariance, H)
            if not piece.seconds:
                return
            u = piece.impulse / piece.seconds
            count = min(parts(model, piece.seconds), most)
            dt = -piece.seconds / count
            for _ in range(count):
                middle = model.step(x, u, 0.5 * dt)  # where a linearisation is of second order
                F, x = model.linearized_step(middle, u, dt).F, model.step(middle, u, 0.5 * dt)
                sensitivity = F[:n, :n] @ sensitivity
                if not np.abs(sensitivity / scales[:, None] * scales).max() < _MOST_GROWTH:
                    return
