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
from kalman_ros.scenario.motions import with_law

#: Reference: a state (n,), or some of its coordinates by name; a function of time that returns
#: either; or a motion.
Reference = Union[ArrayLike, Mapping[str, float], Callable[[float], Any], Motion, None]


@dataclass(frozen=True)
class Law:
    """Law of a controller: gains, limits and reference; a call returns the controller.

    The input begins at the ``idle`` one (m,), zero by default. Gains that are ``fixed`` are the
    caller's, for every set point.
    """

    scenario: Scenario
    feedback: Feedback
    limits: Limits
    reference: Reference
    idle: Array | None = None
    fixed: bool = False

    def __call__(self) -> Answer:
        """Return the controller at its start."""
        return Answer(self)

    @property
    def proportional(self) -> bool:
        """Whether the input is -K x: no integral action, no limit, no reference."""
        plain = not self.feedback.tracked and self.feedback.prediction is None
        return self.reference is None and plain and self.limits.are_none

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

    Estimates (n,) may have leading axes, for that many loops at once.
    """

    def __init__(self, law: Law) -> None:
        self._scenario = scenario = law.scenario
        model = scenario.model
        idle = np.zeros(model.input.size) if law.idle is None else law.idle
        self._limits = law.limits
        self._gains = regulators.SetPointGains(scenario, law.feedback, fixed=law.fixed)
        self._regulator = Regulator(
            model.state, law.feedback, model.equilibrium, limits=law.limits, start=idle
        )
        self._limiter = Limiter(law.limits, idle)
        self._predicts = law.feedback.prediction is not None
        self._reference: Any = law.reference
        self._last: int | None = None
        self._held: Array | None = None
        if law.reference is not None:
            self.follow(0.0)

    def __call__(self, time: int, x: Array) -> Array:
        """Return the input for a time in nanoseconds and an estimate."""
        if callable(self._reference):
            self.follow(time * 1e-9)
        dt = 0.0 if self._last is None else (time - self._last) * 1e-9
        self._last = time
        proposed = self._regulator.propose(x, dt)
        u = self._limiter.toward(proposed, dt or 1.0 / self._scenario.rate)
        self._regulator.applied(x, proposed, u, dt)
        return u

    @property
    def limited(self) -> Any:
        """Number of inputs that a limit has changed."""
        return self._limiter.limited

    @property
    def gain(self) -> Array:
        """K (m, n), about what is held."""
        return self._regulator.feedback.gain

    @property
    def target(self) -> Array:
        """State (n,) that is held."""
        return self._regulator.target[0]

    def hold(self, reference: Reference) -> None:
        """Hold another reference from now on; None stands for the equilibrium.

        Raises
        ------
        ValueError
            If it is not a state of the model, or no input holds the system there; the last
            reference stays.
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
            self._held = None
            return
        if callable(self._reference):
            self._follow_function(self._reference, time)
            return
        state = self._state(self._reference)
        if self._held is None or not np.array_equal(state, self._held):
            self._hold(self._target(state))
            self._held = state

    def _follow_function(self, reference: Callable[[float], Any], time: float) -> None:
        """Hold the state of a function of time, with the input that its change needs."""
        model, dt = self._scenario.model, 1.0 / self._scenario.rate
        state, soon = self._state(reference(time)), self._state(reference(time + dt))
        both = np.array([state, soon])
        if self._held is not None and np.array_equal(both, self._held):
            return
        still = model.is_discrete or np.array_equal(state, soon)
        if still or not regulators.is_moving(self._scenario, state, soon):
            self._hold(self._target(state))
        else:
            self._hold(regulators.moving_target(self._scenario, state, soon))
        self._held = both

    def _hold(self, held: OperatingPoint) -> None:
        """Hold a set point, with the gains there."""
        self._regulator.hold(*held, self._gains.at(held))

    def _fitting(self, motion: Motion) -> Motion:
        """Return a motion, after a check that it is one of this model, at its rate."""
        model, dt = self._scenario.model, 1.0 / self._scenario.rate
        if motion.space.names != model.state.names or abs(motion.dt / dt - 1.0) > 1e-9:
            raise ValueError(
                f'reference: expected a motion of ({", ".join(model.state.names)}) in steps of '
                f'{dt:g} s, got one of ({", ".join(motion.space.names)}) in steps of '
                f'{motion.dt:g} s'
            )
        lacks = motion.differences is None and self._predicts
        return with_law(self._scenario, motion) if lacks else motion

    @cached_property
    def _equilibria(self) -> FeedForward:
        return regulators.tracking(self._scenario)

    def _target(self, state: Array) -> OperatingPoint:
        held = regulators.target(self._scenario, self._equilibria, state)
        regulators.check_held(self._scenario, held.input, self._limits)
        return held

    def _state(self, reference: Any) -> Array:
        space, rest = self._scenario.model.state, self._scenario.model.equilibrium.state
        if reference is None:
            return rest
        if not isinstance(reference, Mapping):
            return vector('reference', reference, space.size)
        state: Array = rest.copy()
        state[space.indices(reference, 'reference')] = vector('reference', [*reference.values()])
        return state
