# SPDX-License-Identifier: Apache-2.0
"""The smoother of Rauch, Tung and Striebel at a fixed lag, at a constant cost for each step.

With d the change of a mean by later readings, a step of the smoother is affine,

    d = C d' + c,   c = C (x' - x_p),   P_s = C P_s' C' + R,

with x' the filter's mean at the next step and the other symbols as in `smoother`. Of a state with
rotations these are differences in the tangent space at x, and d' is about x' where C takes
differences from x_p: with J^-1 the inverse left Jacobian of x' - x_p, the step is

    d = C J^-1 d' + c,

to terms of the order |x' - x_p| |d'|^2 / 12 (the third of Baker, Campbell and Hausdorff).

Affine steps compose to one, and composition is associative, so the steps of a window that slides
are kept as two stacks: one of products up to its top, one whose product is known (two stacks make
a queue; every step is composed three times, whatever the lag). Where a turn is not small, beliefs
are carried back step by step, several in one pass.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Space, is_finite, symmetric
from kalman_ros.linear import single as k

from .filter import SmoothableFilter
from .smoother import Filtered, StepBack, carried_back, step_back, unsmoothable

#: Change of an angle or a rotation, in rad, from which on a belief is computed step by step: a
#: window may turn an angle by more than half a turn, and a rotation by what is not small.
_LARGE = 0.5
_LARGE_ROTATION = 0.05
#: The age, in lags, of the oldest belief at which those that have their lag are computed step by
#: step, all at once.
_LATEST = 1.25


class _Back(NamedTuple):
    """A step backwards: the change d and the covariance of a state, from those of a later one."""

    C: Array
    c: Array
    R: Array

    def after(self, later: _Back) -> _Back:
        """Return the step from further ahead: first ``later``, then this one."""
        C = self.C
        return _Back(C @ later.C, self.c + C @ later.c, k.sandwich(C, later.R, self.R))


class _Window:
    """A queue of steps whose product is known."""

    def __init__(self) -> None:
        #: Products of each of the oldest steps with those up to the last of them, the oldest last.
        self._front: list[_Back] = []
        self._back: list[_Back] = []
        self._product: _Back | None = None

    def push(self, step: _Back) -> None:
        """Add the newest step."""
        self._back.append(step)
        self._product = step if self._product is None else self._product.after(step)

    def pop(self) -> None:
        """Drop the oldest step."""
        self._turn()
        self._front.pop()

    def product(self) -> _Back:
        """Return the step from the newest state to the oldest."""
        self._turn()
        oldest = self._front[-1]
        return oldest if self._product is None else oldest.after(self._product)

    def _turn(self) -> None:
        """Make the newest steps the oldest ones, if there are no others."""
        if self._front:
            return
        product = None
        for step in reversed(self._back):
            product = step if product is None else step.after(product)
            self._front.append(product)
        self._back, self._product = [], None


class FixedLagSmoother:
    """Smoothed beliefs, each with the readings of ``lag`` seconds after it.

    Parameters
    ----------
    space
        Space of the state.
    lag
        Seconds of later readings.
    """

    def __init__(self, space: Space, lag: float) -> None:
        self._space, self._lag = space, round(lag * 1e9)
        self._latest = round(_LATEST * lag * 1e9)
        #: The change of each coordinate from which on it is large.
        self._large_from = np.full(space.size, np.inf)
        self._turns = bool(space.turns)
        self._large_from[space.indices(space.angles)] = _LARGE
        for names in space.rotations:
            self._large_from[space.rotation(names)] = _LARGE_ROTATION
        self.clear()

    def clear(self) -> None:
        """Forget the window: the next step is independent of it."""
        self._steps: deque[Filtered] = deque()
        #: For each step but the newest: the step back to it, and whether the next one is far from
        #: its prediction.
        self._parts: deque[tuple[StepBack, bool]] = deque()
        self._large = 0
        self._window = _Window()

    def add(self, step: Filtered, filter: object) -> Iterator[tuple[int, Gaussian]]:
        """Add the next step; yield the beliefs that have their lag now, and their times.

        A step that is independent of the previous one ends the window: what is in it has all the
        readings that it can have.

        Raises
        ------
        ValueError
            If the filter of the step cannot be smoothed.
        """
        back = None if step.restarted or not self._steps else self._between(step, filter)
        if back is None:
            yield from self.finish()
        else:
            self._window.push(back)
        self._steps.append(step)
        while len(self._steps) > 1 and self._has_passed():
            belief = self._oldest()
            if belief is not None:
                yield self._steps[0].time, belief
                self._drop()
                continue
            # one pass is for many, so that there are few of them
            if self._steps[-1].time - self._steps[0].time < self._latest:
                break
            for belief in self._by_steps()[:-1]:
                if not self._has_passed():
                    break
                yield self._steps[0].time, belief
                self._drop()

    def finish(self) -> Iterator[tuple[int, Gaussian]]:
        """Yield the beliefs of the window, which get no later readings."""
        if self._steps:
            yield from zip([step.time for step in self._steps], self._by_steps())
        self.clear()

    def _has_passed(self) -> bool:
        """Return whether the oldest step has its lag."""
        return self._steps[-1].time - self._steps[0].time >= self._lag

    def _drop(self) -> None:
        self._steps.popleft()
        self._window.pop()
        self._large -= self._parts.popleft()[1]

    def _oldest(self) -> Gaussian | None:
        """Return the oldest belief, given all readings of the window; None if it moves far."""
        C, c, R = self._window.product()
        if self._large or self._is_large(c):
            return None
        x, covariance = self._steps[0].belief.mean, self._steps[-1].belief.covariance
        return Gaussian(*self._space.arrived(x + c, x, symmetric(C @ covariance @ C.T + R)))

    def _is_large(self, change: Array) -> bool:
        return self._turns and bool((np.abs(change) > self._large_from).any())

    def _by_steps(self) -> list[Gaussian]:
        """Return the beliefs of the window as `smooth` does: no turn is beyond half a turn."""
        smoothed = [self._steps[-1].belief]
        steps = reversed([*self._steps][:-1])
        for step, (back, _) in zip(steps, reversed(self._parts)):
            smoothed.append(carried_back(self._space, step.belief, back, smoothed[-1]))
        return smoothed[::-1]

    def _between(self, step: Filtered, filter: object) -> _Back | None:
        """Return the step back from ``step`` to the one before; None if there is none."""
        if not isinstance(filter, SmoothableFilter):
            raise ValueError(f'fixed_lag: {unsmoothable(filter)}')
        try:
            back = step_back(filter, self._steps[-1], step.time)
        except np.linalg.LinAlgError:
            return None
        space, C = self._space, back.C
        change = space.subtract(step.belief.mean, back.predicted)
        slope = C @ space.slope_from_afar(change) if space.rotations else C
        affine = _Back(slope, C @ change, back.R)
        if not all(map(is_finite, affine)):
            return None
        large = self._is_large(change)
        self._parts.append((back, large))
        self._large += large
        return affine
