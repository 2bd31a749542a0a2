# SPDX-License-Identifier: Apache-2.0
"""A motion: the states that a model passes through, and the inputs that move it so."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Space

#: A time this close to a step, in steps, is that of the step.
_AT_A_STEP = 1e-6


class Aim(NamedTuple):
    """State, input and gain of a regulator at a moment: u = input - gain (x - state).

    ``gain`` (m, n) is None where the gain of the law is used.
    """

    state: Array
    input: Array
    gain: Array | None = None


class Differences(NamedTuple):
    """How small differences from a motion move, and what an input costs that is added.

    x_{k+1} = F_k x_k + G_k u_k, F (N + 1, n, n) and G (N + 1, n, m); the weights of an input that
    is added to the regulator's, R + G'S G (N + 1, m, m).
    """

    F: Array
    G: Array
    weights: Array

    def part(self, steps: slice | Array) -> Differences:
        """Return those of some steps."""
        return Differences(*(array[steps] for array in self))


@dataclass(frozen=True, eq=False)
class Motion:
    """States in steps of ``dt``, x_{k+1} = step(x_k, u_k, dt), and the gains that keep them.

    Parameters
    ----------
    space
        Space of the state.
    dt
        Length of a step in seconds.
    states
        x_k (N + 1, n).
    inputs
        u_k (N + 1, m); the last one holds the last state.
    gains
        K_k (N + 1, m, n) of the time-varying regulator; None for the gain of the law.
    differences
        How differences from it move; None where the gain is that of the law.
    rest
        The `feedback.Feedback` about its last state; None where it is that of the law.
    """

    space: Space
    dt: float
    states: Array
    inputs: Array
    gains: Array | None = None
    differences: Differences | None = None
    rest: Any = None

    def __repr__(self) -> str:
        kind = 'the gains of the law' if self.gains is None else 'time-varying gains'
        lines = [f'motion of {self.duration:.4g} s in steps of {self.dt:g} s, {kind}']
        rows = zip(map(self.space.label, self.space.names), self.states.T)
        lines += [
            f'{label:<12} {x[0]:.4g} to {x[-1]:.4g}, within {x.min():.4g} to {x.max():.4g}'
            for label, x in rows
        ]
        return '\n'.join(lines)

    @property
    def duration(self) -> float:
        """Seconds from the first state to the last."""
        return (len(self.states) - 1) * self.dt

    @property
    def time(self) -> Array:
        """Times of the states in seconds (N + 1,)."""
        return np.asarray(np.arange(len(self.states)) * self.dt)

    def moving(self, seconds: float) -> tuple[Array, Array, Array]:
        """Return the state (n,) at the step at or before a time, its rate, and the input (m,)."""
        last = len(self.states) - 1
        step = min(max(int(seconds / self.dt + _AT_A_STEP), 0), last)
        if step == last:
            return self.states[last], np.zeros(self.space.size), self.inputs[last]
        change = self.space.subtract(self.states[step + 1], self.states[step])
        return self.states[step], change / self.dt, self.inputs[max(step - 1, 0)]

    def ahead(self, seconds: float, steps: int) -> Motion:
        """Return the motion of some ``steps`` from a time on; it rests after its end."""
        last = len(self.states) - 1
        first = int(max(seconds, 0.0) / self.dt + _AT_A_STEP)
        index = np.minimum(np.arange(first, first + steps + 1), last)
        return replace(
            self,
            states=self.states[index],
            inputs=self.inputs[index],
            gains=None if self.gains is None else self.gains[index],
            differences=None if self.differences is None else self.differences.part(index),
        )

    def part(self, start: float, end: float) -> Motion:
        """Return the part between two times, from the step at or before the first one."""
        last = len(self.states) - 1
        first = min(int(max(start, 0.0) / self.dt + _AT_A_STEP), last)
        final = min(max(int(end / self.dt + _AT_A_STEP), first), last)
        steps = slice(first, final + 1)
        gains = None if self.gains is None else self.gains[steps]
        differences = None if self.differences is None else self.differences.part(steps)
        return replace(
            self,
            states=self.states[steps],
            inputs=self.inputs[steps],
            gains=gains,
            differences=differences,
            rest=None,
        )

    def then(self, next: Motion) -> Motion:
        """Return this motion, and after it one that begins where it ends."""
        gains = differences = None
        if self.gains is not None and next.gains is not None:
            gains = np.concatenate((self.gains[:-1], next.gains))
        if self.differences is not None and next.differences is not None:
            differences = Differences(
                *(np.concatenate((a[:-1], b)) for a, b in zip(self.differences, next.differences))
            )
        return replace(
            next,
            states=np.concatenate((self.states[:-1], next.states)),
            inputs=np.concatenate((self.inputs[:-1], next.inputs)),
            gains=gains,
            differences=differences,
        )

    def at(self, seconds: float) -> Aim:
        """Return the aim at a time from the start; the first before it, the last after the end.

        Between two steps, the state lies on the straight line between theirs; the input is held.
        """
        last = len(self.states) - 1
        steps = min(max(seconds / self.dt, 0.0), float(last))
        index = int(steps + _AT_A_STEP)
        share = steps - index
        state = self.states[index]
        if share > _AT_A_STEP:
            change = self.space.subtract(self.states[index + 1], state)
            state = self.space.add(state, share * change)
        gain = None if self.gains is None else self.gains[index]
        return Aim(state, self.inputs[index], gain)
