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
        self._steps: deque[Filtered] = deque()
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
            self._steps.popleft()
            self._window.pop()

    def finish(self) -> Iterator[tuple[int, Gaussian]]:
        """Yield the beliefs of the window, which get no later readings."""
        while len(self._steps) > 1:
            yield self._oldest()
            self._steps.popleft()
            self._window.pop()
        for step in self._steps:
            yield step.time, step.belief
        self._steps.clear()
        self._window = _Window()

    def _oldest(self) -> tuple[int, Gaussian]:
        """Return the oldest belief, given all readings of the window."""
        oldest, newest = self._steps[0], self._steps[-1]
        C, c, R = self._window.product()
        x = oldest.belief.mean
        covariance = symmetric(C @ newest.belief.covariance @ C.T + R)
        return oldest.time, Gaussian(*self._space.arrived(x + c, x, covariance))

    def _between(self, step: Filtered, filter: object) -> _Back | None:
        """Return the step back from ``step`` to the one before; None if there is none."""
        if not isinstance(filter, SmoothableFilter):
            raise ValueError(f'fixed_lag: {unsmoothable(filter)}')
        try:
            predicted, C, R = step_back(filter, self._steps[-1], step.time)
        except np.linalg.LinAlgError:
            return None
        back = _Back(C, C @ self._space.subtract(step.belief.mean, predicted), R)
        return back if all(map(is_finite, back)) else None
