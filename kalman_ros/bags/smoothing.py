# SPDX-License-Identifier: Apache-2.0
"""The smoothed states of a replay, from the final beliefs of the estimator."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from kalman_ros.analysis.records import Beliefs
from kalman_ros.core import Array, Gaussian, unchecked
from kalman_ros.estimators.diffuse import Diffuse
from kalman_ros.estimators.filter import SmoothableFilter
from kalman_ros.estimators.instants import Instants
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.smoother import Filtered, smoothed_back, unsmoothable
from kalman_ros.estimators.timeline import Item

from .collecting import BeliefColumns, seconds
from .columns import Rows


class FinalBeliefs:
    """Storage of the last belief of each instant, once nothing can change it any more.

    Beyond a size it is on disk, so that the memory of a long recording is bounded.

    Parameters
    ----------
    online
        The estimator.
    inputs
        Number of inputs.

    Raises
    ------
    ValueError
        If the filter cannot be smoothed.
    """

    def __init__(self, online: OnlineEstimator, inputs: int) -> None:
        if not isinstance(online.filter, SmoothableFilter):
            raise ValueError(f'filter: {unsmoothable()}')
        n = len(online.belief.mean)
        self._rows = Rows(moment=(2,), mean=(n,), covariance=(n, n), input=(inputs,))
        self._instants = Instants()
        self._unknown = False
        self._online = online
        online.on_final = self._take

    def _take(self, items: Sequence[Item]) -> None:
        for step, _ in self._instants.take(items):
            self._keep(step)

    def _keep(self, step: Filtered) -> None:
        if isinstance(step.belief, Diffuse):  # what is unknown has no place in a table
            self._unknown = True
            return
        restarted, self._unknown = step.restarted or self._unknown, False
        # the bits of whole numbers: as a float, a time since 1970 loses nanoseconds
        moment = np.array((step.time, restarted), dtype=np.int64)
        self._rows.append(moment.view(np.float64), *step.belief, step.input)

    def smoothed(self, start: int, without_biases: Callable[[Gaussian], Gaussian]) -> Beliefs:
        """Return the beliefs given all readings, at times in seconds from ``start``.

        Parameters
        ----------
        start
            Time from which seconds are counted, in nanoseconds.
        without_biases
            Function that returns the belief without the biases of sensors.

        Raises
        ------
        ValueError
            If the filter cannot be smoothed.
        """
        self._online.finish()
        for step, _ in self._instants.finish():
            self._keep(step)
        rows = self._rows.columns()
        moments = rows['moment'].view(np.int64)
        beliefs = BeliefColumns(len(without_biases(self._online.belief).mean))
        try:
            for (time, _), belief in zip(
                moments[::-1], smoothed_back(self._online.filter, _backwards(rows, moments))
            ):
                beliefs.add(seconds(int(time), start), without_biases(belief))
        except np.linalg.LinAlgError as error:
            raise ValueError(f'smooth: a prediction cannot be inverted: {error}') from None
        back = beliefs.result()
        return Beliefs(back.time[::-1], back.mean[::-1], back.covariance[::-1])


def _backwards(rows: dict[str, Array], moments: npt.NDArray[np.int64]) -> Iterator[Filtered]:
    """Yield the steps, the last first."""
    for k in range(len(moments) - 1, -1, -1):
        mean, P, u = (np.array(rows[name][k]) for name in ('mean', 'covariance', 'input'))
        time, restarted = moments[k].tolist()
        yield Filtered(time, unchecked((mean, P)), u, bool(restarted))
