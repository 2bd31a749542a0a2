# SPDX-License-Identifier: Apache-2.0
"""The observability of the state from recent readings alone, without the initial belief."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from kalman_ros.core import Array, solve, symmetric
from kalman_ros.estimators.plan import parts
from kalman_ros.linear.structure import Observability
from kalman_ros.scenario import Scenario

from .observability import observability

#: The path reaches back over N readings of the slowest sensor, but not beyond the point where the
#: current state would change by this multiple of the initial uncertainty.
_PIECES, _MOST_GROWTH = 20, 1e3
#: Information below this, relative to that of the initial belief, is rounding.
_NONE = 1e-6
#: The step of numerical derivatives, relative to the initial belief.
_DIFFERENCE = 1e-5


@dataclass
class _Piece:
    """A piece of the path: its start and end (ns), its readings, and the input's integral."""

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

    A state counts as observed if they are more certain than the initial belief.
    """

    std: Array
    verdict: Observability


def readings_alone(gramian: Array, first: Array) -> Array:
    """Return the standard deviation (n,) of each state from readings alone.

    Parameters
    ----------
    gramian
        The information of the readings (n, n), the sum of H' R^-1 H.
    first
        Standard deviations of the initial belief (n,), relative to which information is rounding
        or not; an exactly known state counts in its unit.
    """
    units = _units(first)
    size, directions = np.linalg.eigh(units * symmetric(gramian) * units[:, None])
    variance = np.array([1.0 / s if s > _NONE else inf for s in size.tolist()])
    taking_part = np.where(np.abs(directions) > _NONE, variance, 0.0) * directions**2
    return np.asarray(units * np.sqrt(taking_part.sum(axis=1)))


def _units(first: Array) -> Array:
    return np.where(first > 0.0, first, 1.0)


class ObservabilityMeter:
    """Records recent readings and inputs, and evaluates their observability on request.

    The Gramian of the readings, by the current state x,

        M = sum of (H dx_k/dx)' R^-1 (H dx_k/dx),

    is the inverse of the covariance of an estimate from them alone (R. Hermann and
    A. Krener, Nonlinear Controllability and Observability, IEEE Trans. Automatic Control 22(5),
    1977, for the rank). All is linearised along one path, back from the current estimate with the
    recorded inputs. Along the estimates of each time, which every reading moves, M would count
    unobservable states as observed (G. Huang, A. Mourikis and S. Roumeliotis,
    Observability-based Rules for Designing Consistent EKF SLAM Estimators, Int. J. Robotics
    Research 29(5), 2010).

    The observability of a linear scenario is constant and needs no record; a model in discrete
    time, which cannot go back, is taken where it begins.

    Where the state has many numbers, the whole path takes tens of milliseconds, in which a node
    would answer no reading. A node in real time lets the meter `work` now and then, step by
    step, and `report` has the last path that was completed. Without such work `report` follows
    the whole path.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._pieces: deque[_Piece] = deque(maxlen=_PIECES)
        self.configure(scenario)

    def configure(self, scenario: Scenario) -> None:
        """Use another model, or changed sensors."""
        self._scenario = scenario
        constant = scenario.plan.linear or scenario.model.is_discrete
        self._linear = observability(scenario) if constant else None
        slowest = min((s.timed.rate for s in scenario.enabled.values()), default=inf)
        self._length = 1e9 / slowest
        self.reset()

    def reset(self) -> None:
        """Clear the path."""
        self._pieces.clear()
        self._walk: Iterator[Array] | None = None
        self._found: LocalObservability | None = None
        self._gramian: Array = np.empty(0)
        self._zero: Array = np.zeros(self._scenario.model.input.size)
        self._u: Array = self._zero

    def input(self, time: int, u: Array) -> None:
        """Record the input (m,) in effect from a time in nanoseconds."""
        if self._linear is None:
            self._piece(time)
            self._u = u

    def reading(self, name: str, time: int) -> None:
        """Record that a sensor's reading was used."""
        if self._linear is None:
            self._piece(time).readings[name] += 1

    def _piece(self, time: int) -> _Piece:
        """Return the piece at ``time``, after the input has acted until then."""
        if not self._pieces or time < self._pieces[0].start:  # or the clock went back
            self.reset()
            self._pieces.append(_Piece(time, time, self._zero))
        piece = self._pieces[-1]
        if time > piece.end:
            if piece.end - piece.start >= self._length:
                piece = _Piece(piece.end, piece.end, self._zero)
                self._pieces.append(piece)
            piece.impulse = piece.impulse + (time - piece.end) * 1e-9 * self._u
            piece.end = time
        return piece

    def report(self, x: Array) -> dict[str, str]:
        """Return the observability and its standard deviations, as text."""
        if self._linear is not None:
            return {'observability': str(self._linear)}
        if self._found is None and self._walk is not None:
            return {'observability': 'not known yet'}
        found, space = self._found or self(x), self._scenario.model.state
        deviations = zip(space.names, space.units, found.std.tolist())
        listed = ', '.join(f'{name} {std:.3g} {unit}'.rstrip() for name, unit, std in deviations)
        return {'observability': str(found.verdict), 'latest readings alone, 1 sigma': listed}

    def __call__(self, x: Array) -> LocalObservability:
        """Return the observability, with ``x`` (n,) the current estimate."""
        *_, M = self._gramians(x, reversed(self._pieces))
        return self._judged(M)

    def work(self, estimate: Callable[[], Array]) -> None:
        """Follow the path by one step, and begin again from the ``estimate`` at its end."""
        if self._linear is not None:
            return
        if self._walk is None:
            past = [replace(piece, readings=piece.readings.copy()) for piece in self._pieces]
            self._walk = self._gramians(estimate(), reversed(past))
            next(self._walk)
        M = next(self._walk, None)
        if M is None:
            self._walk, self._found = None, self._judged(self._gramian)
        else:
            self._gramian = M

    def _judged(self, M: Array) -> LocalObservability:
        first = self._scenario.initial_belief.std
        std = readings_alone(M, first)
        return LocalObservability(std, self._verdict(std, first))

    def _verdict(self, std: Array, first: Array) -> Observability:
        names = self._scenario.model.state.names
        seen = tuple(name for name, s, belief in zip(names, std, first) if s <= belief)
        unseen = tuple(name for name in names if name not in seen)
        return Observability(seen, unseen, (), not unseen)

    def _gramians(self, x: Array, path: Iterable[_Piece]) -> Iterator[Array]:
        """Yield the Gramian before the path, which leads back from ``x``, and after each step."""
        model, sensors = self._scenario.model, self._scenario.sensors
        first = _units(self._scenario.initial_belief.std)
        n, h = x.size, _DIFFERENCE * np.diag(first)  # many points take as long as one
        back, M = np.eye(n), np.zeros((n, n))
        yield M
        for piece in path:
            for name, count in piece.readings.items():
                sensor = sensors[name].sensor
                H = sensor.jacobian(x) @ back
                M = M + count * H.T @ solve(sensor.covariance, H)
            if not piece.seconds:
                break
            u = piece.impulse / piece.seconds
            count = parts(model, piece.seconds)
            for _ in range(count):
                x, *near = model.step(np.vstack((x, x + h, x - h)), u, -piece.seconds / count)
                change = model.state.subtract(np.array(near[:n]), np.array(near[n:]))
                back = (change.T / (2.0 * h.diagonal())) @ back
                yield M
                if not np.abs(back / first[:, None] * first).max() < _MOST_GROWTH:
                    return
        yield M
