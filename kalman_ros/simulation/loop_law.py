# SPDX-License-Identifier: Apache-2.0
"""The controller of a loop in this process: the controller node's law, limits and references."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Union

import numpy as np

from kalman_ros.control.feedback import Feedback, Regulator
from kalman_ros.control.limiter import Limiter, Limits
from kalman_ros.control.motion import Motion
from kalman_ros.control.tracking import FeedForward
from kalman_ros.core import Array, ArrayLike, OperatingPoint, vector
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators

#: A state (n,), or some of its coordinates by name; a function of time that returns either; or a
#: motion.
Reference = Union[ArrayLike, Mapping[str, float], Callable[[float], Any], Motion, None]


@dataclass(frozen=True)
class Law:
    """The controller of a loop, which it makes when it is called: gains, limits, reference."""

    scenario: Scenario
    feedback: Feedback
    limits: Limits
    reference: Reference

    def __call__(self) -> Answer:
        """Return the controller at its start."""
        return Answer(self)

    @property
    def proportional(self) -> bool:
        """Whether the input is -K x: no integral action, no limit, no reference."""
        limits = np.isinf([self.limits.magnitude, self.limits.rate])
        plain = not self.feedback.tracked and self.feedback.prediction is None
        return self.reference is None and plain and bool(limits.all())

    def target(self, time: float) -> Array:
        """Return the state (n,) to hold at a time in seconds."""
        if isinstance(self.reference, Motion):
            return self.reference.at(time).state
        answer = self()
        if callable(self.reference):
            answer.follow(time)
        return answer.target


class Answer:
    """The input for each estimate, as from the controller node in lockstep.

    Estimates (n,) may have leading axes: as many loops at once.
    """

    def __init__(self, law: Law) -> None:
        self._scenario = scenario = law.scenario
        model = scenario.model
        self._regulator = Regulator(
            model.state, law.feedback, model.equilibrium, limits=law.limits
        )
        self._limiter = Limiter(law.limits, np.zeros(model.input.size))
        self._reference: Any = law.reference
        self._last: int | None = None
        self._wanted: Array | None = None
        if law.reference is not None:
            self.follow(0.0)

    def __call__(self, time: int, x: Array) -> Array:
        """Return the input for a time in nanoseconds and an estimate."""
        if callable(self._reference):
            self.follow(time * 1e-9)
        dt = 0.0 if self._last is None else (time - self._last) * 1e-9
        self._last = time
        wanted = self._regulator.propose(x, dt)
        u = self._limiter.toward(wanted, dt or 1.0 / self._scenario.rate)
        self._regulator.applied(x, wanted, u, dt)
        return u

    @property
    def limited(self) -> Any:
        """The number of inputs that a limit has changed."""
        return self._limiter.limited

    @property
    def target(self) -> Array:
        """The state (n,) that is held."""
        return self._regulator.target[0]

    def hold(self, reference: Reference) -> None:
        """Hold another reference from now on; None: the equilibrium.

        Raises
        ------
        ValueError
            If it is no state of the model, or no input holds the system there; the last one stays.
        """
        now = 0.0 if self._last is None else self._last * 1e-9
        before, self._reference = self._reference, reference
        try:
            self.follow(now)
        except ValueError:
            self._reference = before
            raise

    def follow(self, time: float) -> None:
        """Hold the reference of a time in seconds; nothing changes while it stays the same."""
        if isinstance(self._reference, Motion):
            self._regulator.follow_motion(self._fitting(self._reference))
            self._wanted = None
            return
        if callable(self._reference):
            self._follow_function(self._reference, time)
            return
        wanted = self._state(self._reference)
        if self._wanted is None or not np.array_equal(wanted, self._wanted):
            self._regulator.hold(*self._target(wanted))
            self._wanted = wanted

    def _follow_function(self, reference: Callable[[float], Any], time: float) -> None:
        """Hold the state of a function of time, with the input that its change needs."""
        model, dt = self._scenario.model, 1.0 / self._scenario.rate
        wanted, soon = self._state(reference(time)), self._state(reference(time + dt))
        both = np.array([wanted, soon])
        if self._wanted is not None and np.array_equal(both, self._wanted):
            return
        still = model.is_discrete or np.array_equal(wanted, soon)
        if still or not regulators.is_moving(self._scenario, wanted, soon):
            self._regulator.hold(*self._target(wanted))
        else:
            self._regulator.hold(*regulators.moving_target(self._scenario, wanted, soon))
        self._wanted = both

    def _fitting(self, motion: Motion) -> Motion:
        """Return a motion that is one of this model, at its rate."""
        model, dt = self._scenario.model, 1.0 / self._scenario.rate
        if motion.space.names != model.state.names or abs(motion.dt / dt - 1.0) > 1e-9:
            raise ValueError(
                f'reference: expected a motion of ({", ".join(model.state.names)}) in steps of '
                f'{dt:g} s, got one of ({", ".join(motion.space.names)}) in steps of '
                f'{motion.dt:g} s'
            )
        return motion

    @cached_property
    def _equilibria(self) -> FeedForward:
        return regulators.tracking(self._scenario)

    def _target(self, wanted: Array) -> OperatingPoint:
        return regulators.target(self._scenario, self._equilibria, wanted)

    def _state(self, given: Any) -> Array:
        space, rest = self._scenario.model.state, self._scenario.model.equilibrium.state
        if given is None:
            return rest
        if not isinstance(given, Mapping):
            return vector('reference', given, space.size)
        wanted: Array = rest.copy()
        wanted[space.indices(given, 'reference')] = vector('reference', [*given.values()])
        return wanted
