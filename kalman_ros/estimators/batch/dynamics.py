# SPDX-License-Identifier: Apache-2.0
"""Steps of a model and readings of a sensor, linearised about any number of states at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kalman_ros.core import (
    Array,
    DiscreteLinearSystem,
    DiscreteModel,
    LinearizedStep,
    LinearSystem,
    Model,
    Sensor,
    numerical_jacobian,
)
from kalman_ros.core.model import like
from kalman_ros.core.vectorized import vectorized
from kalman_ros.linear.batched import product, sandwich, times
from kalman_ros.linear.discretize import flow, noise_integral


class Dynamics:
    """A `Model` for states (..., n): what `Model.linearized_step` is for one.

    Parameters
    ----------
    model
        The model; its own Jacobians and noise need not accept leading axes.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        n, m = model.state.size, model.input.size
        #: Whether `linearized_step` of the model takes leading axes.
        self._leading = takes_leading_axes(model)
        self.linear = isinstance(model, (LinearSystem, DiscreteLinearSystem))
        if self.linear or self._leading:
            return
        if isinstance(model, DiscreteModel):
            self._noise = vectorized(model.noise, n)
            self._jacobian = self._next_jacobian(model)
            return
        self._noise = vectorized(model.noise_density, n)
        if model.analytic:
            self._jacobian = _of_both(model.state_jacobian, n, m)

    @staticmethod
    def _next_jacobian(model: DiscreteModel) -> Callable[[Array, Array], Array]:
        if type(model).next_jacobian is not DiscreteModel.next_jacobian:
            n, m = model.state.size, model.input.size
            return _of_both(lambda x, u: model.next_jacobian(x, u)[0], n, m)
        return lambda x, u: numerical_jacobian(
            lambda points: model.next(points, like(u, points)),
            x,
            model.state.subtract,
            model.state,
        )

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the states (..., n) after ``dt`` seconds, without noise."""
        model = self.model
        if isinstance(model, (LinearSystem, DiscreteLinearSystem)):
            sampled = model.sampled(dt)
            return model.state.wrap(times(sampled.F, x) + times(sampled.G, u))
        return model.step(x, like(u, x), dt)

    def derivative(self, x: Array, u: Array) -> Array:
        """Return dx/dt (..., n) of a model in continuous time."""
        return self.model.derivative(x, like(u, x))

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the states (..., n) after a step, F and Q, (..., n, n) or the same for all."""
        model = self.model
        if self._leading:
            return model.linearized_step(x, like(u, x), dt)
        if isinstance(model, (LinearSystem, DiscreteLinearSystem)):
            sampled = model.sampled(dt)
            return LinearizedStep(self.step(x, u, dt), sampled.F, sampled.Q)
        if isinstance(model, DiscreteModel):
            return self._periods(model, x, u, dt)
        if model.analytic:
            F, Q = _guarded(flow, self._jacobian(x, like(u, x)), self._noise(x), dt)
            return LinearizedStep(model.step(x, u, dt), F, Q)
        moved, F, A = model.differenced_step(x, u, dt)
        (Q,) = _guarded(_noise_alone, A, self._noise(x), dt)
        return LinearizedStep(moved, F, Q)

    def predicted(self, x: Array, P: Array, u: Array, dt: float) -> tuple[Array, Array]:
        """Return x' (..., n) and F P F' + Q after a step."""
        if self._leading:
            found: tuple[Array, Array] = self.model.predicted_moments(x, P, u, dt)  # type: ignore[attr-defined]
            return found
        moved, F, Q = self.linearized_step(x, u, dt)
        return moved, sandwich(F, P, Q)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return Q (..., n, n) of a step, or the same (n, n) for all."""
        model = self.model
        if isinstance(model, (LinearSystem, DiscreteLinearSystem)):
            return model.sampled(dt).Q
        if isinstance(model, DiscreteModel) or model.analytic or self._leading:
            return self.linearized_step(x, u, dt).Q
        A = model.state_jacobian(x, u)
        return _guarded(_noise_alone, A, self._noise(x), dt)[0]

    def step_noise(self, x: Array, u: Array, dt: float) -> Array:
        """Return the Q of `linearized_step`, (..., n, n) or the same (n, n) for all."""
        model = self.model
        if self.linear or isinstance(model, DiscreteModel) or self._leading:
            return self.noise_covariance(x, u, dt)
        A = self._jacobian(x, like(u, x)) if model.analytic else model.differenced_slope(x, u)
        return _guarded(_noise_alone, A, self._noise(x), dt)[0]

    def _periods(self, model: DiscreteModel, x: Array, u: Array, dt: float) -> LinearizedStep:
        u = like(u, x)
        F: Array = np.eye(model.state.size)
        Q: Array = np.zeros_like(F)
        for _ in range(model.periods(dt)):
            F_1 = self._jacobian(x, u)
            F, Q = product(F_1, F), sandwich(F_1, Q, self._noise(x))
            x = model.state.wrap(model.next(x, u))
        return LinearizedStep(x, F, Q)


class Readout:
    """A `Sensor` for states (..., n)."""

    def __init__(self, sensor: Sensor) -> None:
        self.sensor = sensor
        self._own = type(sensor).jacobian is not Sensor.jacobian
        self._known: Callable[[Array], Array] | None = None

    def jacobian(self, x: Array) -> Array:
        """Return d measure / d x (..., k, n), or the same (k, n) for all."""
        if self._known is None:
            takes_any = not self._own or takes_leading_axes(self.sensor)
            jacobian = self.sensor.jacobian
            self._known = jacobian if takes_any else vectorized(jacobian, x.shape[-1])
        return self._known(x)


def takes_leading_axes(part: Model | Sensor) -> bool:
    """Return whether all functions of a model or a sensor take leading axes."""
    return getattr(part, 'takes_leading_axes', False) is True


def _of_both(
    function: Callable[[Array, Array], Array], n: int, m: int
) -> Callable[[Array, Array], Array]:
    """Return a `vectorized` function of state (..., n) and input (..., m)."""
    stacked = vectorized(lambda z: function(z[..., :n], z[..., n:]), n + m)
    return lambda x, u: stacked(np.concatenate((x, u), axis=-1)) if m else stacked(x)


def _noise_alone(A: Array, W: Array, dt: float) -> tuple[Array, ...]:
    return (noise_integral(A, W, dt),)


def _guarded(
    series: Callable[[Array, Array, float], tuple[Array, ...]], A: Array, W: Array, dt: float
) -> tuple[Array, ...]:
    """Return the series, with NaN for the members of a batch for which there is none."""
    try:
        return series(A, W, dt)
    except np.linalg.LinAlgError:
        bad = np.asarray(~np.isfinite(A).all(axis=(-2, -1)))
        if not bad.any():
            raise
    members = bad[..., np.newaxis, np.newaxis]
    found = series(np.where(members, 0.0, A), W, dt)
    return tuple(np.where(members, np.nan, each) for each in found)
