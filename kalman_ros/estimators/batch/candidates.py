# SPDX-License-Identifier: Apache-2.0
"""Several sets of parameters at once: p models or sensors, for states (..., p, n).

Linear models stack their F, G and Q. Others become one model whose parameters are arrays (p,),
if its formulas then give what each gives alone; else each is called in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from kalman_ros.core import (
    Array,
    DiscreteLinearSystem,
    DiscreteModel,
    LinearizedStep,
    LinearSystem,
    Model,
    Sensor,
)
from kalman_ros.core.model import like
from kalman_ros.core.vectorized import merged, probes
from kalman_ros.linear.batched import times

from .dynamics import Dynamics, Readout, takes_leading_axes


def candidate_dynamics(models: Sequence[Model]) -> Dynamics:
    """Return the steps of p models for states (..., p, n)."""
    if all(isinstance(each, (LinearSystem, DiscreteLinearSystem)) for each in models):
        return _LinearCandidates(models)
    whole = merged(models)
    if whole is not None and not isinstance(whole, DiscreteModel):
        together = _MergedCandidates(whole)
        if _agree(together, _EachCandidate(models)):
            return together
    return _EachCandidate(models)


class _LinearCandidates(Dynamics):
    """Linear models: F, G and Q (p, n, n)."""

    def __init__(self, models: Sequence[Model]) -> None:
        super().__init__(models[0])
        self._models = models
        self._sampled: dict[float, tuple[Array, Array, Array]] = {}
        if all(isinstance(each, LinearSystem) for each in models):
            self._A, self._B = (
                np.stack([getattr(each, name) for each in models]) for name in ('A', 'B')
            )

    def _at(self, dt: float) -> tuple[Array, Array, Array]:
        found = self._sampled.get(dt)
        if found is None:
            rest = np.zeros(self.model.state.size), np.zeros(self.model.input.size)
            steps = [each.transition(*rest, dt) for each in self._models]
            F, G, Q = (
                np.stack([getattr(each, name) for each in steps]) for name in ('F', 'G', 'Q')
            )
            if len(self._sampled) > 64:
                self._sampled.clear()
            found = self._sampled[dt] = F, G, Q
        return found

    def derivative(self, x: Array, u: Array) -> Array:
        return times(self._A, x) + times(self._B, like(u, x))

    def step(self, x: Array, u: Array, dt: float) -> Array:
        F, G, _ = self._at(dt)
        return self.model.state.wrap(times(F, x) + times(G, like(u, x)))

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        F, _, Q = self._at(dt)
        return LinearizedStep(self.step(x, u, dt), F, Q)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        return self._at(dt)[2]


class _MergedCandidates(Dynamics):
    """One model whose parameters are arrays (p,)."""

    def __init__(self, whole: Model) -> None:
        self.model = whole
        self.linear = False
        self._leading = takes_leading_axes(whole)
        self._noise = whole.noise_density
        self._jacobian = whole.state_jacobian


class _EachCandidate(Dynamics):
    """Models called in turn."""

    _leading = False  # of all together, whatever each takes

    def __init__(self, models: Sequence[Model]) -> None:
        self.model = models[0]
        self.linear = False
        self._each = [Dynamics(model) for model in models]

    def derivative(self, x: Array, u: Array) -> Array:
        return _in_turn(lambda p, a, b: self._each[p].derivative(a, b), x, u, -2)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        return _in_turn(lambda p, a, b: self._each[p].step(a, b, dt), x, u, -2)

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        u = like(u, x)
        found = [
            each.linearized_step(x[..., p, :], u[..., p, :], dt)
            for p, each in enumerate(self._each)
        ]
        lead = x.shape[:-2]
        F, Q = (
            np.stack([np.broadcast_to(m, (*lead, *m.shape[-2:])) for m in ms], axis=-3)
            for ms in ([one.F for one in found], [one.Q for one in found])
        )
        return LinearizedStep(np.stack([one.state for one in found], axis=-2), F, Q)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        return self.linearized_step(x, u, dt).Q


def _in_turn(
    function: Callable[[int, Array, Array], Array], x: Array, u: Array, axis: int
) -> Array:
    u = like(u, x)
    return np.stack(
        [function(p, x[..., p, :], u[..., p, :]) for p in range(x.shape[-2])], axis=axis
    )


def _agree(a: Dynamics, b: Dynamics) -> bool:
    """Return whether two dynamics of p candidates give the same steps."""
    model = b.model
    n, m = model.state.size, model.input.size
    points = probes(n + m)
    count = len(b._each) if isinstance(b, _EachCandidate) else 1
    z = np.repeat(points[:, np.newaxis], count, axis=1)
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
    R = np.stack([each.covariance for each in sensors])
    base = _together(sensors)
    shared = all(np.array_equal(each, R[0]) for each in R)
    return base if shared else base.with_covariance(R)


def _together(sensors: Sequence[Sensor]) -> Sensor:
    first: Any = sensors[0]
    if hasattr(first, 'merged_numbers'):
        return first.merged_numbers(sensors[1:]) or _EachSensor(sensors)
    others = [{k: v for k, v in vars(each).items() if k != 'covariance'} for each in sensors]
    return first if all(_equal(each, others[0]) for each in others) else _EachSensor(sensors)


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
        self.linear = all(each.linear for each in sensors)
        self._each = [Readout(each) for each in sensors]

    def measure(self, x: Array) -> Array:
        """Return the readings (..., p, k)."""
        parts = [each.sensor.measure(x[..., p, :]) for p, each in enumerate(self._each)]
        return np.stack(parts, axis=-2)

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives (..., p, k, n)."""
        lead, n = x.shape[:-2], x.shape[-1]
        found = [each.jacobian(x[..., p, :]) for p, each in enumerate(self._each)]
        return np.stack([np.broadcast_to(H, (*lead, H.shape[-2], n)) for H in found], axis=-3)
