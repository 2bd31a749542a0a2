# SPDX-License-Identifier: Apache-2.0
"""A state feedback at work: reference, integral, limits, and changes of gain without a bump.

    u = u_e - K (x - x_e) - K_q q

with (x_e, u_e) the equilibrium of the reference and q the integral of the error of the tracked
states. While a limit holds the input back, q does not grow in the direction that asks for more
(conditional integration: K. Astrom and T. Hagglund, Advanced PID Control, 2006, section 3.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf

import numpy as np

from kalman_ros.core import Array, Space

from .state_space import StateSpace
from .structure import ComplexArray


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
        Which p coordinates of the state are integrated.
    poles
        Of the closed loop, sampled (n + p,).
    """

    gain: Array
    integral_gain: Array
    tracked: tuple[int, ...]
    poles: ComplexArray

    def system(self, dt: float) -> StateSpace:
        """Return the law in samples of ``dt`` as a system from x to -u, whose state is q."""
        n, p = self.gain.shape[1], len(self.tracked)
        tracked = np.eye(n)[list(self.tracked)]
        return StateSpace(np.eye(p), dt * tracked, self.integral_gain, self.gain, dt)


@dataclass(frozen=True)
class Limits:
    """What the actuators can do.

    Parameters
    ----------
    magnitude
        The largest magnitude of each input (m,).
    rate
        The largest change of each input a second (m,).
    blend
        Seconds in which a jump that a change of gains would make dies away.
    """

    magnitude: Array
    rate: Array
    blend: float = 0.0

    @staticmethod
    def none(m: int) -> Limits:
        """Return limits that never hold."""
        return Limits(np.full(m, inf), np.full(m, inf))


class Regulator:
    """Answers states with inputs by a `Feedback`.

    Parameters
    ----------
    space
        Of the state, whose differences respect angles.
    feedback
        The gains.
    target
        The state (n,) and input (m,) to hold, at rest.
    limits
        What the actuators can do.
    """

    def __init__(
        self, space: Space, feedback: Feedback, target: tuple[Array, Array], limits: Limits
    ) -> None:
        self._space, self._feedback, self._limits = space, feedback, limits
        self.target = target
        self._integral: Array = np.zeros(len(feedback.tracked))
        self._last: tuple[Array, Array] | None = None
        self._jump: Array = np.zeros(len(feedback.gain))
        #: How many answers a limit has changed.
        self.limited = 0

    @property
    def feedback(self) -> Feedback:
        """The gains in use."""
        return self._feedback

    def adopt(self, feedback: Feedback, limits: Limits) -> None:
        """Use other gains and limits from now on; the input goes on from where it is."""
        if feedback.tracked != self._feedback.tracked:
            self._integral = np.zeros(len(feedback.tracked))
        self._feedback, self._limits = feedback, limits
        if self._last is not None:
            x, u = self._last
            self._jump = u - self._wanted(x)

    def follow(self, x: Array, u: Array) -> None:
        """Take note that the input is ``u`` (m,), whatever the law says; answers go on from it."""
        self._integral = np.zeros(len(self._feedback.tracked))
        self._jump = u - self._wanted(x)
        self._last = x, u

    def release(self, dt: float) -> Array:
        """Return an input (m,) on the way to zero, as fast as the limits allow."""
        if self._last is None:
            return np.zeros(len(self._feedback.gain))
        x, before = self._last
        most = self._reach(dt)
        u: Array = before - np.clip(before, -most, most)
        self.follow(x, u)
        return u

    def answer(self, x: Array, dt: float) -> Array:
        """Return the input (m,) for a state (n,) that came ``dt`` seconds after the last one."""
        limits = self._limits
        self._jump = self._jump * (exp(-dt / limits.blend) if limits.blend > 0.0 else 0.0)
        wanted = self._wanted(x) + self._jump
        u = np.clip(wanted, -limits.magnitude, limits.magnitude)
        if self._last is not None and np.isfinite(limits.rate).any():
            most, before = self._reach(dt), self._last[1]
            u = np.clip(u, before - most, before + most)
        self.limited += int(np.any(u != wanted))
        self._integrate(x, wanted - u, dt)
        self._last = x, u
        return u

    def _reach(self, dt: float) -> Array:
        """Return how far each input may go within ``dt`` seconds (m,)."""
        rate = self._limits.rate
        # in no time, too, an input without a limit may go anywhere
        reach: Array = np.full(rate.shape, inf)
        return np.multiply(rate, dt, out=reach, where=np.isfinite(rate))

    def _wanted(self, x: Array) -> Array:
        state, input = self.target
        error = self._space.subtract(x, state)
        feedback = self._feedback
        u: Array = input - feedback.gain.dot(error) - feedback.integral_gain.dot(self._integral)
        return u

    def _integrate(self, x: Array, excess: Array, dt: float) -> None:
        feedback = self._feedback
        if not feedback.tracked:
            return
        error = self._space.subtract(x, self.target[0])[list(feedback.tracked)]
        more = -feedback.integral_gain.dot(error)
        if not np.any(more * excess > 0.0):
            self._integral = self._integral + error * dt
