# SPDX-License-Identifier: Apache-2.0
"""Models and sensors whose linearisations take leading axes, as their functions do.

A class of a user may define Jacobians and noise for one state (n,). `stacked` and
`stacked_sensor` return the same model or sensor for states (..., n).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np

from kalman_ros.linear.batched import product, sandwich, times
from kalman_ros.linear.discretize import flow, noise_integral
from kalman_ros.linear.matrices import Array

from .discrete_model import DiscreteModel
from .dynamics import Dynamics, LinearDynamics, LinearizedStep, OperatingPoint, Transition
from .model import Model, like, numerical_jacobian
from .sensor import Sensor
from .vectorized import vectorized


def takes_leading_axes(part: Dynamics | Sensor) -> bool:
    """Return whether all functions of a model or a sensor take leading axes."""
    return getattr(part, 'takes_leading_axes', False) is True


def stacked(model: Dynamics) -> Dynamics:
    """Return the same model with linearised steps of states (..., n)."""
    if takes_leading_axes(model):
        return model
    if model.is_linear:
        return StackedLinearModel(model)
    if isinstance(model, DiscreteModel):
        return StackedDiscreteModel(model)
    return StackedModel(model)


class _Stacked(Dynamics):
    """A model for states (..., n) and inputs (..., m) or (m,); F and Q are (..., n, n).

    Parameters
    ----------
    original
        Model whose Jacobians and noise need not accept leading axes.
    """

    takes_leading_axes = True

    def __init__(self, original: Dynamics) -> None:
        self.original: Any = original
        self.state, self.input = original.state, original.input
        self.max_step, self.is_discrete = original.max_step, original.is_discrete
        if original.is_discrete:
            self.period = original.period
        self._prepare()

    def _prepare(self) -> None:
        """Determine how the functions of the original take leading axes."""

    @property
    def equilibrium(self) -> OperatingPoint:
        """Operating point at which the model rests."""
        point: OperatingPoint = self.original.equilibrium
        return point

    def noise_density(self, x: Array) -> Array:
        """Return the spectral density W (n, n) of the process noise at ``x`` (n,)."""
        density: Array = self.original.noise_density(x)
        return density

    def transition(self, x: Array, u: Array, dt: float) -> Transition:
        """Return the step from one state (n,)."""
        transition: Transition = self.original.transition(x, u, dt)
        return transition

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the states after ``dt`` seconds, without noise."""
        moved: Array = self.original.step(x, like(u, x), dt)
        return moved

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return the Q of `linearized_step`."""
        return self.linearized_step(x, u, dt).Q


class StackedModel(_Stacked, Model):
    """A model in continuous time for states (..., n)."""

    def _prepare(self) -> None:
        model, n, m = self.original, self.state.size, self.input.size
        self._noise = vectorized(model.noise_density, n)
        if model.analytic:
            self._jacobian = _of_both(model.state_jacobian, n, m)

    def noise_density(self, x: Array) -> Array:
        """Return the spectral density W of the process noise, (..., n, n) or the same (n, n)."""
        return self._noise(x)

    def derivative(self, x: Array, u: Array) -> Array:
        """Return dx/dt (..., n)."""
        rate: Array = self.original.derivative(x, like(u, x))
        return rate

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the states after a step, F and Q."""
        model = self.original
        if model.analytic:
            F, Q = _guarded(flow, self._jacobian(x, like(u, x)), self._noise(x), dt)
            return LinearizedStep(self.step(x, u, dt), F, Q)
        moved, F, A = model.differenced_step(x, u, dt)
        (Q,) = _guarded(_noise_alone, A, self._noise(x), dt)
        return LinearizedStep(moved, F, Q)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return Q of a step, with A as `state_jacobian` has it."""
        if self.original.analytic:
            return self.linearized_step(x, u, dt).Q
        A = self.original.state_jacobian(x, u)
        return _guarded(_noise_alone, A, self._noise(x), dt)[0]

    def step_noise(self, x: Array, u: Array, dt: float) -> Array:
        """Return the Q of `linearized_step`."""
        model = self.original
        A = self._jacobian(x, like(u, x)) if model.analytic else model.differenced_slope(x, u)
        return _guarded(_noise_alone, A, self._noise(x), dt)[0]


class StackedLinearModel(LinearDynamics, _Stacked):
    """A linear model; F and Q are (n, n), the same for all states."""

    def sampled(self, dt: float) -> Transition:
        """Return the step of length ``dt``."""
        transition: Transition = self.original.sampled(dt)
        return transition

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return F x + G u."""
        F, G, _ = self.sampled(dt)
        return self.state.wrap(times(F, x) + times(G, like(u, x)))

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return F x + G u, F and Q."""
        F, _, Q = self.sampled(dt)
        return LinearizedStep(self.step(x, u, dt), F, Q)


class StackedDiscreteModel(_Stacked):
    """A model in discrete time."""

    def _prepare(self) -> None:
        model, n, m = self.original, self.state.size, self.input.size
        self._noise = vectorized(model.noise, n)
        if type(model).next_jacobian is not DiscreteModel.next_jacobian:
            self._jacobian = _of_both(lambda x, u: model.next_jacobian(x, u)[0], n, m)
        else:
            self._jacobian = lambda x, u: numerical_jacobian(
                lambda points: model.next(points, like(u, points)),
                x,
                model.state.subtract,
                model.state,
            )

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the states after whole periods, F and Q."""
        model, u = self.original, like(u, x)
        F: Array = np.eye(self.state.size)
        Q: Array = np.zeros_like(F)
        for _ in range(model.periods(dt)):
            F_1 = self._jacobian(x, u)
            F, Q = product(F_1, F), sandwich(F_1, Q, self._noise(x))
            x = self.state.wrap(model.next(x, u))
        return LinearizedStep(x, F, Q)


def stacked_sensor(sensor: Sensor) -> Sensor:
    """Return the same sensor with a Jacobian (..., k, n), or the same (k, n), of states (..., n).

    The Jacobian of the class `Sensor` takes leading axes; one of a subclass may not.
    """
    inherited = type(sensor).jacobian is Sensor.jacobian
    if inherited or takes_leading_axes(sensor):
        return sensor
    return StackedSensor(sensor)


class StackedSensor(Sensor):
    """A sensor for states (..., n)."""

    takes_leading_axes = True

    def __init__(self, original: Sensor) -> None:
        self.original = original
        self.output, self.covariance, self.name = (
            original.output, original.covariance, original.name
        )  # fmt: skip
        self.state, self.linear = original.state, original.linear
        self._jacobian: Callable[[Array], Array] | None = None

    def measure(self, x: Array) -> Array:
        """Return the readings (..., k)."""
        return self.original.measure(x)

    def jacobian(self, x: Array) -> Array:
        """Return d measure / d x (..., k, n), or the same (k, n) for all."""
        if self._jacobian is None:
            self._jacobian = vectorized(self.original.jacobian, x.shape[-1])
        return self._jacobian(x)

    def with_covariance(self, covariance: Array) -> StackedSensor:
        """Return the same sensor with another noise."""
        other = copy(self)
        other.covariance, other.original = covariance, self.original.with_covariance(covariance)
        return other


def _of_both(
    function: Callable[[Array, Array], Array], n: int, m: int
) -> Callable[[Array, Array], Array]:
    """Return a `vectorized` function of state (..., n) and input (..., m)."""
    both = vectorized(lambda z: function(z[..., :n], z[..., n:]), n + m)
    return lambda x, u: both(np.concatenate((x, u), axis=-1)) if m else both(x)


def _noise_alone(A: Array, W: Array, dt: float) -> tuple[Array, ...]:
    return (noise_integral(A, W, dt),)


def _guarded(
    series: Callable[[Array, Array, float], tuple[Array, ...]], A: Array, W: Array, dt: float
) -> tuple[Array, ...]:
    """Return the series, with NaN for the members of a batch for which it does not exist."""
    try:
        return series(A, W, dt)
    except np.linalg.LinAlgError:
        bad = np.asarray(~np.isfinite(A).all(axis=(-2, -1)) | ~np.isfinite(W).all(axis=(-2, -1)))
        if not bad.any():
            raise
    members = bad[..., np.newaxis, np.newaxis]
    values = series(np.where(members, 0.0, A), np.where(members, 0.0, W), dt)
    return tuple(np.where(members, np.nan, value) for value in values)
