# SPDX-License-Identifier: Apache-2.0
"""Predictions and corrections of a belief in C, one by one and a whole pass at once."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from kalman_ros.core import Array, Dynamics, Gaussian, Sensor, definite, is_finite, unchecked
from kalman_ros.core.dynamics import CorrectedMoments
from kalman_ros.core.ordered_data import FirstSteps, OrderedData, StepMatrices

from .native_pass import MOST_STATES, run, run_first
from .native_pass import declare as declare_pass
from .numbered import COUNT, NUMBER, POINTER, address, declare, hold, memory

#: Most numbers of a reading for which C corrects many members.
MOST_READ = 12


class NativeRecursion(Dynamics):
    """A model whose library predicts and corrects single beliefs."""

    _c_library: Any
    #: The address of the numbers of the model.
    _c_p: int
    _c_shapes: tuple[tuple[int], tuple[int]]
    #: The address of `NativeSpace.arrived`; 0 without rotations.
    _c_arrived: int

    def predicted_moments(
        self, x: Array, P: Array, u: Array, dt: float, number: int = 1
    ) -> Gaussian:
        """Return means (..., n) and covariances (..., n, n) after linearised steps."""
        n = x.shape[-1]
        if (x.shape, u.shape) != self._c_shapes or P.shape != (n, n) or number < 1:
            return self._c_predicted(x, P, u, dt, number)
        at_P = n + u.size
        mean = at_P + n * n
        covariance = mean + n
        v = np.empty(covariance + n * n + 1)
        v[:n], v[n:at_P], v[at_P:mean] = x, u, P.ravel()
        self._c_library.predictions(address(memory(v)), 1, dt, self.max_step, number, self._c_p, 1)
        moments = v[mean:covariance], v[covariance:-1].reshape(n, n)
        if v[-1] == 1.0:
            return definite(moments)
        if not is_finite(v[mean:]):
            return super().predicted_moments(x, P, u, dt, number)
        return unchecked(moments)

    def _c_predicted(self, x: Array, P: Array, u: Array, dt: float, number: int) -> Gaussian:
        """Return the `predicted_moments` of anything but one belief."""
        return super().predicted_moments(x, P, u, dt, number)

    def corrected(self, x: Array, P: Array, y: Array, sensor: Any) -> CorrectedMoments:
        """Return the belief x, P after a reading y (..., k) of a sensor, with what led there."""
        n, k, R = x.shape[-1], y.shape[-1], sensor.covariance
        if ((n,), (k,), (n, n), (k, k)) != (x.shape, y.shape, P.shape, R.shape):
            return super().corrected(x, P, y, sensor)
        if (n,) != self._c_shapes[0] or k > MOST_READ or n > MOST_STATES:
            return super().corrected(x, P, y, sensor)
        at_H = n + n * n
        at_R = at_H + k * n
        at_e = at_R + k * k
        mean = at_e + k
        covariance = mean + n
        K = covariance + n * n
        S = K + n * k
        v = np.empty(S + k * k + 1)
        v[:n], v[n:at_H], v[at_R:at_e] = x, P.ravel(), R.ravel()
        if getattr(sensor, '_c_sets', 0) == 1 and sensor._c_shapes == (x.shape, y.shape):
            reads = sensor._c_reads
            v[at_e:mean] = y
        else:
            reads = 0, 0, 0, 0
            v[at_H:at_R] = sensor.jacobian(x).ravel()
            v[at_e:mean] = sensor.output.subtract(y, sensor.measure(x))
        failed = self._c_library.correction(address(memory(v)), k, *reads, self._c_arrived)
        if failed == 1:
            return super().corrected(x, P, y, sensor)  # which finds out what is wrong
        return (
            v[mean:covariance],
            v[covariance:K].reshape(n, n),
            v[at_e:mean],
            v[S:-1].reshape(k, k),
            v[K:S].reshape(n, k),
            v[at_H:at_R].reshape(k, n),
            float(v[-1]),
            not failed,
        )

    def filter_pass(
        self,
        belief: tuple[Array, Array],
        data: OrderedData,
        parts: Any,
        sensors: Sequence[Sensor],
        limits: Sequence[float],
        kept: bool = True,
    ) -> StepMatrices | None:
        """Return the matrices of an extended filter that processes data in order."""
        return run(self, belief, data, parts, sensors, limits, kept, MOST_READ)

    has_first_steps = True

    def first_steps(
        self,
        belief: tuple[Array, Array],
        data: OrderedData,
        parts: Any,
        sensors: Sequence[Sensor],
        limits: Sequence[float],
    ) -> FirstSteps | None:
        """Return the steps of an extended filter before a reading beyond its limit."""
        return run_first(self, belief, data, parts, sensors, limits, MOST_READ)


def declare_recursion(library: Any) -> None:
    """Declare the functions of the library of a model that predict and correct."""
    declare(library, 'predictions', NUMBER, NUMBER, COUNT)
    hold(library, 'correction', ctypes.c_int, POINTER, COUNT, *[POINTER] * 5)
    declare_pass(library)
