# SPDX-License-Identifier: Apache-2.0
"""Several sets of parameters at once: p models or sensors as one, for states (..., p, n).

Linear models stack their F, G and Q. Others become one model whose parameters are arrays (p,),
if its formulas then agree with those of the single models; else these are called in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from kalman_ros.linear.batched import times
from kalman_ros.linear.matrices import Array

from .discrete_model import DiscreteModel
from .dynamics import Dynamics, LinearizedStep, Transition
from .model import like
from .sensor import Sensor
from .stacked import StackedLinearModel, StackedModel, stacked, stacked_sensor, takes_leading_axes
from .vectorized import merged, probes


def candidate_model(models: Sequence[Dynamics]) -> Dynamics:
    """Return one model with p sets of parameters, for states (..., p, n)."""
    if all(model.is_linear for model in models):
        return _LinearCandidates(models)
    whole = merged(models)
    if whole is not None and not isinstance(whole, DiscreteModel):
        together = whole if takes_leading_axes(whole) else _MergedCandidates(whole)
        if _agree(together, _EachCandidate(models)):
            return together
    return _EachCandidate(models)


class _LinearCandidates(StackedLinearModel):
    """Linear models: F, G and Q (p, n, n)."""

    def __init__(self, models: Sequence[Dynamics]) -> None:
        super().__init__(models[0])
        self._models = models
        self._sampled: dict[float, Transition] = {}

    @cached_property
    def _matrices(self) -> tuple[Array, Array]:
        """A (p, n, n) and B (p, n, m) of models in continuous time."""
        models: Sequence[Any] = self._models
        return np.stack([model.A for model in models]), np.stack([model.B for model in models])

    def derivative(self, x: Array, u: Array) -> Array:
        A, B = self._matrices
        return times(A, x) + times(B, like(u, x))

    def sampled(self, dt: float) -> Transition:
        transition = self._sampled.get(dt)
        if transition is None:
            steps = [model.sampled(dt) for model in self._models]  # type: ignore[attr-defined]
            if len(self._sampled) > 64:
                self._sampled.clear()
            transition = self._sampled[dt] = Transition(*map(np.stack, zip(*steps)))
        return transition


class _MergedCandidates(StackedModel):
    """One model whose parameters are arrays (p,)."""

    def _prepare(self) -> None:
        self._noise, self._jacobian = self.original.noise_density, self.original.state_jacobian


class _EachCandidate(StackedModel):
    """Models called in turn."""

    def __init__(self, models: Sequence[Dynamics]) -> None:
        self._members = [stacked(model) for model in models]
        super().__init__(models[0])

    def _prepare(self) -> None:
        pass

    def derivative(self, x: Array, u: Array) -> Array:
        return self._in_turn(lambda model, x, u: model.derivative(x, u), x, u)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        return self._in_turn(lambda model, x, u: model.step(x, u, dt), x, u)

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        u = like(u, x)
        steps = [
            model.linearized_step(x[..., p, :], u[..., p, :], dt)
            for p, model in enumerate(self._members)
        ]
        lead = x.shape[:-2]
        F, Q = (
            np.stack([np.broadcast_to(m, (*lead, *m.shape[-2:])) for m in ms], axis=-3)
            for ms in ([one.F for one in steps], [one.Q for one in steps])
        )
        return LinearizedStep(np.stack([one.state for one in steps], axis=-2), F, Q)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        return self.linearized_step(x, u, dt).Q

    def _in_turn(
        self, function: Callable[[Any, Array, Array], Array], x: Array, u: Array
    ) -> Array:
        u = like(u, x)
        moved = [
            function(model, x[..., p, :], u[..., p, :]) for p, model in enumerate(self._members)
        ]
        return np.stack(moved, axis=-2)


def _agree(a: Dynamics, b: _EachCandidate) -> bool:
    """Return whether two models of p candidates give the same steps."""
    n, m = b.state.size, b.input.size
    points = probes(n + m)
    z = np.repeat(points[:, np.newaxis], len(b._members), axis=1)
    try:
        one = a.linearized_step(z[..., :n], z[..., n:], 0.01)
    except Exception:  # a formula may fail on parameters that are arrays in any way
        return False
    other = b.linearized_step(z[..., :n], z[..., n:], 0.01)
    return all(
        np.broadcast_shapes(x.shape, y.shape) == y.shape and np.allclose(x, y, rtol=1e-9)
        for x, y in zip(one, other)
    )


def candidate_sensor(sensors: Sequence[Sensor]) -> Sensor:
    """Return one sensor with p sets of parameters, for states (..., p, n).

    Its covariance is (p, k, k) if the sensors differ in theirs.
    """
    R = np.stack([sensor.covariance for sensor in sensors])
    base = _combined_sensor(sensors)
    shared = all(np.array_equal(covariance, R[0]) for covariance in R)
    return base if shared else base.with_covariance(R)


def _combined_sensor(sensors: Sequence[Sensor]) -> Sensor:
    first: Any = sensors[0]
    if hasattr(first, 'merged_numbers'):
        return first.merged_numbers(sensors[1:]) or _EachSensor(sensors)
    others = [{k: v for k, v in vars(sensor).items() if k != 'covariance'} for sensor in sensors]
    alike = all(_equal(other, others[0]) for other in others)
    return stacked_sensor(first) if alike else _EachSensor(sensors)


def _equal(a: dict[str, object], b: dict[str, object]) -> bool:
    try:
        return a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) for k in a)  # type: ignore[arg-type]
    except Exception:  # values of a user's class
        return False


class _EachSensor(Sensor):
    """Sensors called in turn."""

    takes_leading_axes = True

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        first = sensors[0]
        self.output, self.covariance, self.name = first.output, first.covariance, first.name
        self.linear = all(sensor.linear for sensor in sensors)
        self._members = [stacked_sensor(sensor) for sensor in sensors]

    def measure(self, x: Array) -> Array:
        """Return the readings (..., p, k)."""
        parts = [sensor.measure(x[..., p, :]) for p, sensor in enumerate(self._members)]
        return np.stack(parts, axis=-2)

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives (..., p, k, n)."""
        lead, n = x.shape[:-2], x.shape[-1]
        jacobians = [sensor.jacobian(x[..., p, :]) for p, sensor in enumerate(self._members)]
        return np.stack([np.broadcast_to(H, (*lead, H.shape[-2], n)) for H in jacobians], axis=-3)
