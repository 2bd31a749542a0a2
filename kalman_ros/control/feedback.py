# SPDX-License-Identifier: Apache-2.0
"""State feedback with reference and integral, and bumpless changes of gain.

    u = u_e - K (x - x_e) - K_q q

with (x_e, u_e) the equilibrium of the reference and q the integral of the error of the tracked
states. While an input is limited, q does not grow in the direction of the limit
(conditional integration: K. Astrom and T. Hagglund, Advanced PID Control, 2006, section 3.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.linear.batched import times
from kalman_ros.linear.structure import ComplexArray

from .state_space import StateSpace


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
    """

    def __init__(
        self, space: Space, feedback: Feedback, target: tuple[Array, Array], blend: float = 0.0
    ) -> None:
        self._space, self._feedback, self._blend = space, feedback, blend
        self.target = target
        self._integral: Array = np.zeros(len(feedback.tracked))
        self._last: tuple[Array, Array] | None = None
        self._jump: Array = np.zeros(len(feedback.gain))

    @property
    def feedback(self) -> Feedback:
        """The gains in use."""
        return self._feedback

    def adopt(self, feedback: Feedback, blend: float) -> None:
        """Use other gains from now on; the input is continuous."""
        if feedback.tracked != self._feedback.tracked:
            self._integral = np.zeros(len(feedback.tracked))
        self._feedback, self._blend = feedback, blend
        if self._last is not None:
            x, u = self._last
            self._jump = u - self._wanted(x)

    def follow(self, x: Array, u: Array) -> None:
        """Set the current input to ``u`` (m,); the next ones continue from it."""
        self._integral = np.zeros(len(self._feedback.tracked))
        self._jump = u - self._wanted(x)
        self._last = x, u

    def propose(self, x: Array, dt: float) -> Array:
        """Return the input (m,) for a state (n,) ``dt`` seconds after the last one."""
        self._jump = self._jump * (exp(-dt / self._blend) if self._blend > 0.0 else 0.0)
        return self._wanted(x) + self._jump

    def applied(self, x: Array, wanted: Array, u: Array, dt: float) -> None:
        """Record that ``u`` (m,) was applied where ``wanted`` (m,) had been proposed."""
        self._integrate(x, wanted - u, dt)
        self._last = x, u

    def _wanted(self, x: Array) -> Array:
        state, input = self.target
        error = self._space.subtract(x, state)
        feedback = self._feedback
        u: Array = input - times(feedback.gain, error)
        return u - times(feedback.integral_gain, self._integral) if feedback.tracked else u

    def _integrate(self, x: Array, excess: Array, dt: float) -> None:
        feedback = self._feedback
        if not feedback.tracked:
            return
        error = self._space.subtract(x, self.target[0])[..., list(feedback.tracked)]
        more = -times(feedback.integral_gain, error)
        held = np.any(more * excess > 0.0, axis=-1, keepdims=True)
        self._integral = self._integral + np.where(held, 0.0, error * dt)
