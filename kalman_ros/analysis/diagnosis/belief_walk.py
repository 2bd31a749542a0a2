# SPDX-License-Identifier: Apache-2.0
"""The belief of an extended Kalman filter on its way from reading to reading."""

from __future__ import annotations

from math import isfinite

import numpy as np

from kalman_ros.core import Array, Gaussian, Model
from kalman_ros.estimators.filter import parts
from kalman_ros.linear.matrices import identity
from kalman_ros.linear.single import sandwich, scaled

from .evidence import Evidence

#: A step is as long as the model allows if it is longer only by the rounding of stamps.
_ROUNDING = 1e-6


class Walk:
    """The belief on its way through time from a first one, with the inputs held in between."""

    def __init__(self, model: Model, evidence: Evidence, first: Gaussian) -> None:
        self._model = model
        self.x, self.P = first
        inputs = evidence.inputs
        order = np.argsort(inputs.stamp, kind='stable')
        self._times: list[float] = [*np.round(inputs.stamp[order], 9).tolist(), np.inf]
        self._inputs = inputs.value[order]
        self._next, self._time = 0, -np.inf
        self._skipped: tuple[Array, Array, float] | None = None
        self._resting = bool(evidence.parameters.get('rest_until_input')) and len(order) > 0
        self.u: Array = np.zeros(self._model.input.size)

    def skip(self, F: Array, Q: Array, dt: float) -> None:
        """Count the step to a reading that is left out as part of the next one."""
        self._skipped = F, Q, dt

    def to(self, time: float) -> tuple[Array, Array, float]:
        """Go on to ``time`` (s); return F, Q and the length of that step."""
        begin = self._time
        F, Q, before = self._skipped or (None, None, 0.0)
        self._skipped = None
        while self._times[self._next] < time:
            at = self._times[self._next]
            F, Q = self._moved(at, F, Q)
            self.u, self._resting = self._inputs[self._next], False
            self._next += 1
        F, Q = self._moved(time, F, Q)
        if F is None or Q is None:
            F, Q = identity(self.x.size), np.zeros((self.x.size, self.x.size))
        return F, Q, before + (time - begin if np.isfinite(begin) else 0.0)

    def _moved(
        self, time: float, F: Array | None, Q: Array | None
    ) -> tuple[Array | None, Array | None]:
        """Go on to ``time`` (s); return F and Q, None if nothing has moved, so far."""
        dt = round(time - self._time, 9)  # so that equal steps are equal numbers
        if isfinite(dt) and dt > 0.0 and not self._resting:
            count = parts(self._model, dt * (1.0 - _ROUNDING))
            for _ in range(count):
                self.x, A, W = self._model.linearized_step(self.x, self.u, dt / count)
                self.P = sandwich(A, self.P, W)
                if F is None or Q is None:
                    F, Q = A, W
                else:
                    F, Q = scaled(A, F), sandwich(A, Q, W)
        self._time = max(self._time, time)
        return F, Q
