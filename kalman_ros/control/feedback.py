# SPDX-License-Identifier: Apache-2.0
"""State feedback with reference and integral, and bumpless changes of gain and reference.

    u = u_e - K (x - x_e) - K_q q

with (x_e, u_e) the equilibrium of the reference, or a moment of a `Motion`, and q the integral of
the error of the tracked states. While an input is limited, q does not grow in the direction of
the limit (conditional integration: K. Astrom and T. Hagglund, Advanced PID Control, 2006, section
3.5). Where limits are predicted, u has a part for them; see `predictive`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.linear.batched import times
from kalman_ros.linear.structure import ComplexArray

from .limiter import Limits
from .motion import Aim, Motion
from .predictive import Prediction, Predictor
from .state_space import StateSpace

#: Seconds in which the jump of a change of gains decays, where none are given.
TRANSITION_TIME = 0.5


@dataclass(frozen=True)
class Feedback:
    """The gains of a law.

    Parameters
    ----------
    gain
        K (m, n).
    integral_gain
        K_q (m, p); p is 0 without integral action.
    tracked
        The p coordinates of the state that are integrated.
    poles
        Of the closed loop, sampled (n + p,).
    prediction
        Where limits are predicted, what is needed for it.
    """

    gain: Array
    integral_gain: Array
    tracked: tuple[int, ...]
    poles: ComplexArray
    prediction: Prediction | None = None

    def system(self, dt: float) -> StateSpace:
        """Return the law in samples of ``dt`` as a system from x to -u, whose state is q."""
        n, p = self.gain.shape[1], len(self.tracked)
        tracked = np.eye(n)[list(self.tracked)]
        return StateSpace(np.eye(p), dt * tracked, self.integral_gain, self.gain, dt)


class Regulator:
    """Turns states into inputs by a `Feedback`.

    It proposes an input and is then given the one applied; limits are the caller's. States (n,)
    and inputs (m,) may have leading axes: as many loops at once.

    Parameters
    ----------
    space
        Of the state, whose differences handle angles.
    feedback
        The gains.
    target
        The state (n,) and input (m,) to hold, at rest.
    blend
        Seconds in which the jump of a change of gains decays.
    limits
        Limits of the input, for a law that predicts them.
    budget
        Seconds in which it has to.
    start
        The input (m,) before the first; zero by default.
    """

    def __init__(
        self,
        space: Space,
        feedback: Feedback,
        target: tuple[Array, Array],
        blend: float = 0.0,
        limits: Limits | None = None,
        budget: float = inf,
        start: Array | None = None,
    ) -> None:
        self._start = np.zeros(len(feedback.gain)) if start is None else start
        self._space, self._blend = space, blend
        #: The gains of the law, and those in use, about what is held.
        self._law = self._feedback = feedback
        self._limits = limits or Limits.none(len(feedback.gain))
        self._budget = budget
        self._predictor = self._predictor_of(feedback)
        self._motion: Motion | None = None
        self._elapsed = 0.0
        self._aim = Aim(*target)
        self._integral: Array = np.zeros(len(feedback.tracked))
        self._last: tuple[Array, Array] | None = None
        self._jump: Array = np.zeros(len(feedback.gain))
        #: The last input without what limits added to it.
        self._base: Array | None = None
        self._begun = False

    @property
    def feedback(self) -> Feedback:
        """The gains in use."""
        return self._feedback

    @property
    def target(self) -> tuple[Array, Array]:
        """The state (n,) and the input (m,) that are held now."""
        return self._aim.state, self._aim.input

    @property
    def motion(self) -> Motion | None:
        """The motion that is followed, until its end."""
        return self._motion

    @property
    def elapsed(self) -> float:
        """Seconds since the motion began."""
        return self._elapsed

    @property
    def input(self) -> Array:
        """The last input (m,); that of the target before the first."""
        return self._aim.input if self._last is None else self._last[1]

    def hold(self, state: Array, input: Array, feedback: Feedback | None = None) -> None:
        """Hold a state (n,) with an input (m,) from now on; a motion ends without a jump.

        The gains are those of the ``feedback`` there, by default of the law.
        """
        moving, self._motion = self._motion, None
        self._elapsed = 0.0
        self._use(feedback or self._law)
        self._aim = Aim(state, input)
        if moving is not None:
            self._continue()

    def follow_motion(self, motion: Motion, elapsed: float = 0.0, *, smooth: bool = True) -> None:
        """Follow a motion from now on, from a time in it on.

        Its time is the sum of the ``dt`` of `propose`, so that it waits while there is none. The
        input is continuous if it is ``smooth``.
        """
        self._use(self._law)
        self._motion, self._elapsed, self._begun = motion, elapsed, False
        self._aim = motion.at(elapsed)
        if smooth:
            self._continue()

    @property
    def predictor(self) -> Predictor | None:
        """The predictor of limits; None for a law that does not predict them."""
        return self._predictor

    def _predictor_of(self, feedback: Feedback) -> Predictor | None:
        if feedback.prediction is None:
            return None
        return Predictor(feedback.prediction, self._limits, self._budget)

    def adopt(
        self,
        law: Feedback,
        blend: float,
        limits: Limits | None = None,
        held: Feedback | None = None,
    ) -> None:
        """Use other gains, and limits if given, from now on; the input is continuous.

        Those ``held`` are the gains about what is held, by default those of the law.
        """
        self._law, self._blend = law, blend
        self._use(held or law, limits)
        if self._motion is None:
            self._aim = Aim(*self.target)
        self._continue()

    def _use(self, feedback: Feedback, limits: Limits | None = None) -> None:
        if feedback is self._feedback and limits is None:
            return
        self._limits = limits or self._limits
        self._predictor = self._predictor_of(feedback)
        if feedback.tracked != self._feedback.tracked:
            self._integral = np.zeros(len(feedback.tracked))
        self._feedback = feedback

    def _continue(self) -> None:
        """Let the input go on from its last value."""
        if self._last is not None:
            x, u = self._last
            reached = u if self._predictor is None or self._base is None else self._base
            self._jump = reached - self._by_gain(x)

    def follow(self, x: Array, u: Array) -> None:
        """Set the current input to ``u`` (m,); the next ones continue from it."""
        self._integral = np.zeros(len(self._feedback.tracked))
        self._jump = u - self._by_gain(x)
        self._last, self._base = (x, u), None
        if self._predictor is not None:
            self._predictor.forget()

    def propose(self, x: Array, dt: float) -> Array:
        """Return the input (m,) for a state (n,) ``dt`` seconds after the last one."""
        if self._motion is not None:
            self._advance(self._motion, dt)
        self._jump = self._jump * (exp(-dt / self._blend) if self._blend > 0.0 else 0.0)
        self._base = u = self._by_gain(x) + self._jump
        return u if self._predictor is None else u + self._correction(self._predictor, x, u)

    def _advance(self, motion: Motion, dt: float) -> None:
        """Move the aim along the motion; the last one of a motion is held."""
        self._elapsed += dt if self._begun else 0.0
        self._begun = True
        self._aim = motion.at(self._elapsed)
        if self._elapsed >= motion.duration:
            self._motion = None
            if motion.rest is not None:
                self._use(motion.rest)
                self._aim = Aim(*self.target)

    def applied(self, x: Array, wanted: Array, u: Array, dt: float) -> None:
        """Record that ``u`` (m,) was applied where ``wanted`` (m,) had been proposed."""
        self._integrate(x, wanted - u, dt)
        self._last = x, u

    def _by_gain(self, x: Array) -> Array:
        state, input, gain = self._aim
        error = self._space.subtract(x, state)
        feedback = self._feedback
        u: Array = input - times(feedback.gain if gain is None else gain, error)
        return u - times(feedback.integral_gain, self._integral) if feedback.tracked else u

    def _correction(self, predictor: Predictor, x: Array, u: Array) -> Array:
        """Return what the limits add to an input (m,)."""
        if self._motion is None and not self._feedback.gain.any():
            return np.zeros_like(u)  # it is not regulated at rest
        moving = self._motion
        if moving is not None and moving.gains is not None and moving.differences is None:
            return np.zeros_like(u)  # how differences from it move is not known
        error = self._space.subtract(x, self._aim.state)
        before = np.broadcast_to(self._start, u.shape) if self._last is None else self._last[1]
        return predictor.correction(error, self._ahead(predictor.steps), before)

    def _ahead(self, steps: int) -> Motion:
        """Return the reference from now on, with the jump that decays as part of its input."""
        if self._motion is None:
            state, input, _ = self._aim
            ahead = Motion(self._space, 0.0, state[np.newaxis], input[np.newaxis])
        else:
            ahead = self._motion.ahead(self._elapsed, steps)
        alone = self._jump.ndim == 1 and self._jump.any()
        return replace(ahead, inputs=ahead.inputs + self._jump) if alone else ahead

    def _integrate(self, x: Array, excess: Array, dt: float) -> None:
        feedback = self._feedback
        if not feedback.tracked:
            return
        error = self._space.subtract(x, self._aim.state)[..., list(feedback.tracked)]
        more = -times(feedback.integral_gain, error)
        held = np.any(more * excess > 0.0, axis=-1, keepdims=True)
        self._integral = self._integral + np.where(held, 0.0, error * dt)
