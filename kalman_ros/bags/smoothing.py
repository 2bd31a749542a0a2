# SPDX-License-Identifier: Apache-2.0
"""The smoothed states of a replay, from what the estimator had settled on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kalman_ros.analysis.records import Beliefs
from kalman_ros.core import Gaussian
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.smoother import Filtered, smooth
from kalman_ros.estimators.timeline import Item

from .collecting import BeliefColumns, seconds


class FinalBeliefs:
    """Keeps the last belief of each instant, once nothing can change it any more.

    Parameters
    ----------
    online
        The estimator.
    """

    def __init__(self, online: OnlineEstimator) -> None:
        self._steps: list[Filtered] = []
        self._online = online
        online.on_final = self._take

    def _take(self, items: Sequence[Item]) -> None:
        steps = self._steps
        for item in items:
            state = item.after
            if state.u is None:  # it rests until its first input
                continue
            time = item.key[0]
            restarted = item.restarted or not steps or time < steps[-1].time
            if steps and time == steps[-1].time:
                restarted |= steps.pop().restarted
            steps.append(Filtered(time, state.belief, state.u, restarted))

    def smoothed(self, start: int) -> Beliefs:
        """Return the beliefs given all readings, at times in seconds from ``start``.

        Raises
        ------
        ValueError
            If the filter is of a kind that cannot be smoothed.
        """
        self._online.finish()
        found = BeliefColumns(len(self._online.belief.mean))
        for step, belief in zip(self._steps, self._all()):
            found.add(seconds(step.time, start), belief)
        return found.result()

    def _all(self) -> list[Gaussian]:
        try:
            return smooth(self._online.filter, self._steps)
        except np.linalg.LinAlgError as error:
            raise ValueError(f'smooth: a prediction cannot be inverted: {error}') from None
