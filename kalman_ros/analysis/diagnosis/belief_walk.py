# SPDX-License-Identifier: Apache-2.0
"""Propagation of the belief of a filter from reading to reading, with each linearised step."""

from __future__ import annotations

from math import isfinite

import numpy as np

from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.filter import SmoothableFilter
from kalman_ros.linear.matrices import identity
from kalman_ros.linear.single import sandwich, scaled

from .evidence import Evidence


class Walk:
    """A belief that is propagated through time, with inputs held until the next input."""

    def __init__(self, filter: SmoothableFilter, evidence: Evidence, first: Gaussian) -> None:
        self._filter = filter
        self.belief = first
        inputs = evidence.inputs
        order = np.argsort(inputs.stamp, kind='stable')
        self._times: list[float] = [*np.round(inputs.stamp[order], 9).tolist(), np.inf]
        self._inputs = inputs.value[order]
        self._next, self._time = 0, -np.inf
        self._skipped: tuple[Array, Array, float] | None = None
        self._resting = bool(evidence.parameters.get('rest_until_input')) and len(order) > 0
        self.u: Array = np.zeros(filter.model.input.size)

    def skip(self, F: Array, Q: Array, dt: float) -> None:
        """Merge the step to a reading that is omitted into the next step."""
        self._skipped = F, Q, dt

    def to(self, time: float) -> tuple[Array, Array, float]:
        """Propagate the belief to ``time`` (s); return F, Q and the duration of the step."""
        begin = self._time
        F, Q, skipped = self._skipped or (None, None, 0.0)
        self._skipped = None
        while self._times[self._next] < time:
            input_time = self._times[self._next]
            F, Q = self._propagate(input_time, F, Q)
            self.u, self._resting = self._inputs[self._next], False
            self._next += 1
        F, Q = self._propagate(time, F, Q)
        if F is None or Q is None:
            n = self._filter.model.state.size
            F, Q = identity(n), np.zeros((n, n))
        return F, Q, skipped + (time - begin if np.isfinite(begin) else 0.0)

    def _propagate(
        self, time: float, F: Array | None, Q: Array | None
    ) -> tuple[Array | None, Array | None]:
        """Propagate the belief to ``time`` (s); return the F and Q so far, None without a step."""
        dt = round(time - self._time, 9)  # rounded, so that equal steps have equal durations
        if isfinite(dt) and dt > 0.0 and not self._resting:
            self.belief, F_k, Q_k = self._filter.linearized(self.belief, self.u, dt)
            if F is None or Q is None:
                F, Q = F_k, Q_k
            else:
                F, Q = scaled(F_k, F), sandwich(F_k, Q, Q_k)
        self._time = max(self._time, time)
        return F, Q
