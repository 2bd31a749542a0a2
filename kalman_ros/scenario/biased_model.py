# SPDX-License-Identifier: Apache-2.0
"""Models and sensors with the biases of sensors behind the state, as random walks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kalman_ros.core import (
    Array,
    LinearizedStep,
    LinearSystem,
    Model,
    OperatingPoint,
    Sensor,
    Space,
    Transition,
)


def blocks(first: Array, second: Array) -> Array:
    """Return the matrices (..., n, m) and (k, k) as the blocks of (..., n + k, m + k)."""
    lead, (n, m), k = first.shape[:-2], first.shape[-2:], len(second)
    upper = np.concatenate((first, np.zeros((*lead, n, k))), -1)
    lower = np.concatenate((np.zeros((k, m)), second), -1)
    return np.concatenate((upper, np.broadcast_to(lower, (*lead, *lower.shape))), -2)


def longer(first: Array, rest: Array) -> Array:
    """Return vectors (..., n) with ``rest`` (..., k) behind them."""
    return np.concatenate((first, np.broadcast_to(rest, (*first.shape[:-1], rest.shape[-1]))), -1)


class BiasedModel(Model):
    """A model with random walks behind its state.

    Parameters
    ----------
    model
        Of the first states.
    names, units
        Of the walks.
    density
        Their spectral density (k, k).
    """

    def __init__(
        self, model: Model, names: Sequence[str], units: Sequence[str], density: Array
    ) -> None:
        self._model, self._density = model, density
        self._n, k = model.state.size, len(names)
        self.state, self.input = with_names(model.state, names, units), model.input
        self.max_step = model.max_step
        self._still, self._kept = np.zeros(k), np.eye(k)

    @property
    def equilibrium(self) -> OperatingPoint:
        """Operating point of the model, without a bias."""
        x, u = self._model.equilibrium
        return OperatingPoint(longer(x, self._still), u)

    @property
    def analytic(self) -> bool:
        """Whether the model has an analytic Jacobian."""
        return self._model.analytic

    def _own(self, x: Array) -> Array:
        return x[..., : self._n]

    def derivative(self, x: Array, u: Array) -> Array:
        """Return that of the model, and zeros."""
        return longer(self._model.derivative(self._own(x), u), self._still)

    def noise_density(self, x: Array) -> Array:
        """Return that of the model, and that of the walks."""
        return blocks(self._model.noise_density(self._own(x)), self._density)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return that of the model, and zeros."""
        return blocks(self._model.state_jacobian(self._own(x), u), np.zeros_like(self._kept))

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return that of the model, and zeros."""
        B = self._model.input_jacobian(self._own(x), u)
        return np.concatenate((B, np.zeros((*B.shape[:-2], len(self._kept), B.shape[-1]))), -2)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the step of the model; the walks stay."""
        return np.concatenate((self._model.step(self._own(x), u, dt), x[..., self._n :]), -1)

    def transition(self, x: Array, u: Array, dt: float) -> Transition:
        """Return that of the model, with the walks."""
        transition = self._model.transition(self._own(x), u, dt)
        still = np.zeros((*transition.G.shape[:-2], len(self._kept), transition.G.shape[-1]))
        G = np.concatenate((transition.G, still), axis=-2)
        return Transition(blocks(transition.F, self._kept), G, self._walked(transition.Q, dt))

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return that of the model, with the walks."""
        state, F, Q = self._model.linearized_step(self._own(x), u, dt)
        moved = np.concatenate((state, x[..., self._n :]), -1)
        return LinearizedStep(moved, blocks(F, self._kept), self._walked(Q, dt))

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return that of the model, and that of the walks."""
        return self._walked(self._model.noise_covariance(self._own(x), u, dt), dt)

    def _walked(self, Q: Array, dt: float) -> Array:
        return blocks(Q, abs(dt) * self._density)


def with_names(space: Space, names: Sequence[str], units: Sequence[str]) -> Space:
    """Return a space with further coordinates."""
    return Space(
        (*space.names, *names), (*space.units, *units), space.angles, rotations=space.rotations
    )


class BiasedSensor(Sensor):
    """A sensor of the first states of a `BiasedModel`, which reads a bias more if it has one.

    Parameters
    ----------
    sensor
        Without a bias.
    state
        All states.
    place
        Where its bias is among them.
    """

    def __init__(self, sensor: Sensor, state: Space, place: slice) -> None:
        self._sensor, self._n, self._own = sensor, sensor.state.size, place
        self.output, self.covariance = sensor.output, sensor.covariance
        self.state, self.name, self.linear = state, sensor.name, sensor.linear
        self._C = np.zeros((sensor.output.size, state.size))
        self._has = place.stop > place.start
        if self._has:
            self._C[:, place] = np.eye(sensor.output.size)

    def measure(self, x: Array) -> Array:
        """Return the reading with its bias; that of a rotation is a turn in the world."""
        y = self._sensor.measure(x[..., : self._n])
        return self.output.add(y, x[..., self._own]) if self._has else y

    def jacobian(self, x: Array) -> Array:
        """Return that of the sensor, and ones for its bias."""
        if self.output.rotations:  # a turn by the bias turns what the sensor reads
            return super().jacobian(x)
        H = self._sensor.jacobian(x[..., : self._n])
        jacobian = np.broadcast_to(self._C, (*H.shape[:-1], self._C.shape[-1])).copy()
        jacobian[..., : self._n] = H
        return np.asarray(jacobian)


def biased_model(
    model: Model, names: Sequence[str], units: Sequence[str], density: Array
) -> Model:
    """Return the model with its walks; one that is linear stays linear."""
    if not isinstance(model, LinearSystem):
        return BiasedModel(model, names, units, density)
    k = len(names)
    B = np.concatenate((model.B, np.zeros((k, model.input.size))))
    state = with_names(model.state, names, units)
    A, W = blocks(model.A, np.zeros((k, k))), blocks(model.W, density)
    return LinearSystem(A, B, W, state, model.input)
