# SPDX-License-Identifier: Apache-2.0
"""Test vectors: what Python computes of a loop, call by call, for C to repeat."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kalman_ros.control.feedback import Regulator
from kalman_ros.control.limiter import Limiter
from kalman_ros.core import Array
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.scenario import regulator as regulators
from kalman_ros.simulation.simulated_plant import SimulatedPlant

from .loop import LONGEST_PASSED, Loop

#: The numbers of outcomes in C.
OUTCOMES = {
    Outcome.FUSED: 0,
    Outcome.RECOVERED: 1,
    Outcome.REJECTED: 2,
    Outcome.OUTVOTED: 3,
    Outcome.INDEFINITE: 4,
    Outcome.NOT_FINITE: 5,
    Outcome.BAD_COVARIANCE: 6,
    Outcome.DUPLICATE: 7,
}
_RESTARTED, _BAD_TIME, _UNREACHABLE = 8, 9, 10


class Call(NamedTuple):
    """A call of the library, and what is there after it.

    Parameters
    ----------
    kind
        P: predict, C: correct, I: input, H: hold, M: follow, U: control, O: idle.
    sensor
        Its index, of a correction.
    given
        Its numbers.
    outcome
        As `OUTCOMES`.
    mean, std, input
        The estimate (n,), its standard deviations (n,) and the input (m,) afterwards.
    """

    kind: str
    sensor: int
    given: Array
    outcome: int
    mean: Array
    std: Array
    input: Array


class Calls:
    """A loop as C runs it, computed by Python.

    Parameters
    ----------
    loop
        What is exported.
    """

    def __init__(self, loop: Loop) -> None:
        self._loop = loop
        self._estimator = loop.estimation.online(loop.idle)
        self._names = [*loop.sensors]
        self._time, self._input = 0, loop.idle
        self._begun = self._released = False
        law = loop.law
        if law is not None:
            self._regulator = Regulator(law.space, law.feedback, law.rest, law.blend)
            self._limiter = Limiter(law.limits, loop.idle)
        self._estimator.add_input(0, self._input)

    def predict(self, dt: float) -> Call:
        """Let ``dt`` seconds pass."""
        if not 0.0 <= dt < 1e9:
            return self._call('P', 0, [dt], _BAD_TIME)
        before, passed = self._estimator.restarts, round(dt * 1e9)
        self._time += passed
        self._estimator.add_input(self._time, self._input)
        restarted = self._estimator.restarts > before
        # Python's stamps are whole nanoseconds
        return self._call('P', 0, [passed * 1e-9], _RESTARTED if restarted else 0)

    def correct(self, index: int, y: Array, R: Array | None = None) -> Call:
        """Fuse a reading, with the covariance of its message."""
        given = [*y, *(() if R is None else R.ravel())]
        outcome, _ = self._estimator.add_reading(self._names[index], self._time, y, R)
        return self._call('C', index, given, OUTCOMES[outcome])

    def input(self, u: Array) -> Call:
        """Let an input act from now on."""
        if not np.isfinite(u).all():
            return self._call('I', 0, u, OUTCOMES[Outcome.NOT_FINITE])
        self._act(u)
        return self._call('I', 0, u, 0)

    def hold(self, reference: Array) -> Call:
        """Hold a state."""
        law = self._loop.law
        assert law is not None
        if not np.isfinite(reference).all():
            return self._call('H', 0, reference, OUTCOMES[Outcome.NOT_FINITE])
        try:
            held = regulators.target(self._loop.scenario, law.equilibria, reference)
            regulators.check_held(self._loop.scenario, held.input, law.limits)
        except ValueError:
            return self._call('H', 0, reference, _UNREACHABLE)
        self._regulator.hold(*held)
        return self._call('H', 0, reference, 0)

    def follow(self) -> Call:
        """Follow the motion from its beginning."""
        law = self._loop.law
        assert law is not None and law.motion is not None
        self._regulator.follow_motion(law.motion)
        return self._call('M', 0, [], 0)

    def control(self, dt: float) -> Call:
        """Let the law act."""
        law = self._loop.law
        assert law is not None
        x = self._estimator.predicted(self._time).mean[: law.space.size]
        passed = min(dt, LONGEST_PASSED) if self._begun else 0.0
        if self._released:
            self._regulator.follow(x, self._limiter.value)
            self._released = False
        wanted = self._regulator.propose(x, passed)
        u = self._limiter.toward(wanted, dt or 1.0 / self._loop.rate)
        self._regulator.applied(x, wanted, u, passed)
        self._begun = True
        self._act(u)
        return self._call('U', 0, [dt], 0)

    def idle(self, dt: float) -> Call:
        """Let the input go towards the idle one."""
        self._act(self._limiter.toward_idle(dt))
        self._released = True
        return self._call('O', 0, [dt], 0)

    def _act(self, u: Array) -> None:
        self._input = u
        self._estimator.add_input(self._time, u)

    def _call(self, kind: str, index: int, given: object, outcome: int) -> Call:
        belief = self._estimator.predicted(self._time)
        numbers = np.array(given, dtype=float).ravel()
        return Call(kind, index, numbers, outcome, belief.mean, belief.std, self._input)


def recorded(loop: Loop, steps: int, seed: int = 1, *, hostile: bool = True) -> Iterator[Call]:
    """Yield the calls of a simulated run of the loop, with what may go wrong in it.

    Parameters
    ----------
    loop
        What is exported.
    steps
        Their number.
    seed
        Seed of all noise.
    hostile
        Whether some readings are outliers, repeated, not finite, or have a covariance, and some
        steps are none.
    """
    scenario = loop.scenario
    timed = {name: source.timed for name, source in scenario.sensors.items()}
    start = scenario.initial_state
    plant = SimulatedPlant(scenario.model, timed, scenario.rate, start, seed, loop.idle)
    calls, names, dt = Calls(loop), [*loop.sensors], 1.0 / scenario.rate
    random = np.random.default_rng(seed)
    m, gates = scenario.model.input.size, loop.estimation.policy.gates or {}
    gated = [name in gates for name in names]
    for step in range(steps):
        if step:
            if hostile and step % 97 == 11:
                yield calls.predict(-dt)
            yield calls.predict(dt)
        for name, y in plant.readings().items():
            index, R = names.index(name), None
            if hostile:
                phase = (step + 31 * index) % 211
                if gated[index] and 100 <= phase < 140 and index == (step // 211) % len(names):
                    y = y + 30.0 * np.sqrt(loop.sensors[name].covariance.diagonal())
                elif phase == 50:
                    y = np.where(np.arange(y.size) == 0, np.nan, y)
                elif phase == 60:
                    R = 4.0 * loop.sensors[name].covariance
                elif phase == 70:
                    R = -loop.sensors[name].covariance
            yield calls.correct(index, y, R)
            if hostile and phase == 80:
                yield calls.correct(index, y, R)
        if loop.law is None:
            u = loop.idle + (random.standard_normal(m) if step % 20 == 5 else 0.0)
            call = calls.input(u) if m else None
        else:
            motion = loop.law.motion
            rows = 0 if motion is None else len(motion.states)
            phase = step % (rows + 200)
            if rows and phase == 20:
                yield calls.follow()
            if phase == rows + 150:
                yield calls.hold(_reference(loop, random))
            idle = hostile and 80 <= step % 500 < 84
            call = calls.idle(dt) if idle else calls.control(dt)
        if call is not None:
            yield call
        plant.step(loop.idle if call is None else call.input)


def _reference(loop: Loop, random: np.random.Generator) -> Array:
    """Return a state near the one at rest, which may be one that no input holds."""
    law = loop.law
    assert law is not None
    equilibrium = law.equilibria.nearest(0.1 * random.standard_normal(law.space.size))
    return np.asarray(law.rest.state + equilibrium.state)


def text(loop: Loop, calls: list[Call]) -> str:
    """Return calls as lines of hexadecimal numbers, after the largest magnitude of each result."""
    results = np.array([np.concatenate((c.mean, c.std, c.input)) for c in calls])
    lines = [_numbers(np.abs(results).max(axis=0))]
    lines += [
        f'{c.kind} {c.sensor} {c.given.size} {_numbers(c.given)} {c.outcome} '
        f'{_numbers(np.concatenate((c.mean, c.std, c.input)))}'
        for c in calls
    ]
    return '\n'.join((*lines, 'E', ''))


def _numbers(values: Array) -> str:
    return ' '.join(float(value).hex() for value in values)
