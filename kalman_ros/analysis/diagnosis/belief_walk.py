# SPDX-License-Identifier: Apache-2.0
"""The belief of an extended Kalman filter on its way from reading to reading."""

from __future__ import annotations

from math import isfinite

import numpy as np

from kalman_ros.core import Array, DiscreteLinearSystem, Gaussian, LinearSystem, Model
from kalman_ros.estimators.filter import parts
from kalman_ros.linear.kernels import sandwich, scaled
from kalman_ros.linear.matrices import identity

from .evidence import Evidence

#: A step is as long as the model allows if it is longer only by the rounding of stamps.
_ROUNDING = 1e-6
#: Steps of nonlinear models up to this (s) are taken by their linearisation.
_SHORT = 0.02


class Walk:
    """The belief on its way through time from a first one, with the inputs held in between."""

    def __init__(self, evidence: Evidence, first: Gaussian) -> None:
        self._model = evidence.scenario.model
        self._exact = is_linear(self._model)
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
                A, W = transition(self._model, self.x, self.u, dt / count)
                self.x = self._stepped(A, dt / count)
                self.P = sandwich(A, self.P, W)
                if F is None or Q is None:
                    F, Q = A, W
                else:
                    F, Q = scaled(A, F), sandwich(A, Q, W)
        self._time = max(self._time, time)
        return F, Q

    def _stepped(self, F: Array, dt: float) -> Array:
        """Return the state after a step; a short one by F, x + (I + F) f(x) dt / 2.

        It is right to the second order in dt, as F is, and takes a quarter of the evaluations.
        Where rotations turn, the midpoint rule is that.
        """
        model = self._model
        if self._exact or dt > _SHORT:
            return model.step(self.x, self.u, dt)
        if model.state.rotations:
            middle = model.state.add(self.x, 0.5 * dt * model.derivative(self.x, self.u))
            return model.state.add(self.x, dt * model.derivative(middle, self.u))
        moved = (0.5 * dt) * model.derivative(self.x, self.u)
        return model.state.wrap(self.x + moved + F.dot(moved))


def is_linear(model: Model) -> bool:
    """Return whether steps of a model are linear, or known in no other way."""
    return isinstance(model, (LinearSystem, DiscreteLinearSystem)) or not hasattr(
        model, 'derivative'
    )


def transition(model: Model, x: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """Return F and Q (n, n) of a short step: exact where linear, else to second order in dt."""
    if is_linear(model):
        step = model.transition(x, u, dt)
        return step.F, step.Q
    A, W = dt * model.state_jacobian(x, u), dt * model.noise_density(x)
    F = 0.5 * A.dot(A)
    F += A
    F += identity(len(A))
    half = 0.5 * A.dot(W)
    half += A.dot((half + half.T) / 3.0)
    W += half
    W += half.T
    return F, W
