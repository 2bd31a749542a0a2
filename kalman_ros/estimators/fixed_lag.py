# SPDX-License-Identifier: Apache-2.0
"""The smoother of Rauch, Tung and Striebel at a fixed lag, at a constant cost for each step.

With d the change of a mean by later readings, a step of the smoother is affine,

    d = C d' + c,   c = C (x' - x_p),   P_s = C P_s' C' + R,

with x' the filter's mean at the next step and the other symbols as in `smoother`. Affine steps
compose to one, and composition is associative, so the steps of a window that slides are kept as
two stacks: one of products up to its top, one whose product is known (two stacks make a queue;
every step is composed three times, whatever the lag).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Space, is_finite, symmetric

from .filter import SmoothableFilter
from .smoother import Filtered, step_back, unsmoothable

#: Change of an angle, in rad, from which on a window may turn one by more than half a turn.
_LARGE = 0.5


class _Back(NamedTuple):
    """A step backwards: the change d and the covariance of a state, from those of a later one."""

    C: Array
    c: Array
    R: Array

    def after(self, later: _Back) -> _Back:
        """Return the step from further ahead: first ``later``, then this one."""
        C = self.C
        return _Back(C @ later.C, self.c + C @ later.c, self.R + C @ later.R @ C.T)


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
        Space of the state, without rotations.
    lag
        Seconds of later readings.

    Raises
    ------
    ValueError
        If the space has rotations.
    """

    def __init__(self, space: Space, lag: float) -> None:
        if space.rotations:
            names = '; '.join(' '.join(names) for names in space.rotations)
            raise ValueError(
                f'fixed_lag: not for a state with rotations ({names}): '
                'smooth a recording, with replay --smooth'
            )
        self._space, self._lag = space, round(lag * 1e9)
        self._angles = [space.names.index(name) for name in space.angles]
        self.clear()

    def clear(self) -> None:
        """Forget the window: the next step is independent of it."""
        self._steps: deque[Filtered] = deque()
        #: For each step but the newest: C, the prediction of the next, and whether that turned
        #: an angle by much.
        self._parts: deque[tuple[Array, Array, bool]] = deque()
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
        while step.time - self._steps[0].time >= self._lag and len(self._steps) > 1:
            yield self._oldest()
            self._drop()

    def finish(self) -> Iterator[tuple[int, Gaussian]]:
        """Yield the beliefs of the window, which get no later readings."""
        while len(self._steps) > 1:
            yield self._oldest()
            self._drop()
        for step in self._steps:
            yield step.time, step.belief
        self.clear()

    def _drop(self) -> None:
        self._steps.popleft()
        self._window.pop()
        self._large -= self._parts.popleft()[2]

    def _oldest(self) -> tuple[int, Gaussian]:
        """Return the oldest belief, given all readings of the window."""
        oldest, newest = self._steps[0], self._steps[-1]
        C, c, R = self._window.product()
        x = oldest.belief.mean
        covariance = symmetric(C @ newest.belief.covariance @ C.T + R)
        if self._large or (np.abs(c[self._angles]) > _LARGE).any():
            return oldest.time, Gaussian(self._mean_by_steps(), covariance)
        return oldest.time, Gaussian(*self._space.arrived(x + c, x, covariance))

    def _mean_by_steps(self) -> Array:
        """Return the oldest mean, each change of an angle taken within half a turn on the way."""
        space, later = self._space, self._steps[-1].belief.mean
        steps = reversed([*self._steps][:-1])
        for step, (C, predicted, _) in zip(steps, reversed(self._parts)):
            later = space.wrap(step.belief.mean + C @ space.subtract(later, predicted))
        return later

    def _between(self, step: Filtered, filter: object) -> _Back | None:
        """Return the step back from ``step`` to the one before; None if there is none."""
        if not isinstance(filter, SmoothableFilter):
            raise ValueError(f'fixed_lag: {unsmoothable(filter)}')
        try:
            predicted, C, R = step_back(filter, self._steps[-1], step.time)
        except np.linalg.LinAlgError:
            return None
        change = self._space.subtract(step.belief.mean, predicted)
        back = _Back(C, C @ change, R)
        if not all(map(is_finite, back)):
            return None
        large = bool((np.abs(change[self._angles]) > _LARGE).any())
        self._parts.append((C, predicted, large))
        self._large += large
        return back
