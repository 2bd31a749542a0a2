# SPDX-License-Identifier: Apache-2.0
"""The smoother of Rauch, Tung and Striebel at a fixed lag, at a constant cost for each step.

Its steps are affine and compose to one, and composition is associative, so the steps of a window
that slides are kept as two stacks: one of products up to its top, one whose product is known (two
stacks make a queue; every step is composed three times, whatever the lag).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Gaussian, Space, is_finite

from .diffuse import Diffuse
from .filter import SmoothableFilter
from .smoother import Change, Filtered, StepBack, step_back, unsmoothable


class _Window:
    """A queue of steps whose product is known."""

    def __init__(self) -> None:
        #: Products of each of the oldest steps with those up to the last of them, the oldest last.
        self._front: list[StepBack] = []
        self._back: list[StepBack] = []
        self._product: StepBack | None = None

    def push(self, step: StepBack) -> None:
        """Add the newest step."""
        self._back.append(step)
        self._product = step if self._product is None else self._product.after(step)

    def pop(self) -> StepBack:
        """Drop the oldest step; return that from the newest state to the oldest."""
        self._turn()
        oldest = self._front.pop()
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
        self.clear()

    def clear(self) -> None:
        """Forget the window: the next step is independent of it."""
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
        while len(self._steps) > 1 and step.time - self._steps[0].time >= self._lag:
            yield self._pop()

    def finish(self) -> Iterator[tuple[int, Gaussian]]:
        """Yield the beliefs of the window, which get no later readings."""
        while self._steps:
            yield self._pop()

    def _pop(self) -> tuple[int, Gaussian]:
        """Drop the oldest step; return its time, and its belief given all readings so far."""
        last, step = self._steps[-1].belief, self._steps.popleft()
        if not self._steps:
            return step.time, step.belief
        back = self._window.pop()
        if isinstance(last, Diffuse):
            return step.time, step.belief
        change = back.of(Change(np.zeros(self._space.size), last.covariance))
        return step.time, change.applied(self._space, step.belief.mean)

    def _between(self, step: Filtered, filter: object) -> StepBack | None:
        """Return the step back from ``step`` to the one before; None if there is none."""
        if not isinstance(filter, SmoothableFilter):
            raise ValueError(f'fixed_lag: {unsmoothable()}')
        try:
            back = step_back(filter, self._steps[-1], step)
        except np.linalg.LinAlgError:
            return None
        return back if all(map(is_finite, back)) else None
