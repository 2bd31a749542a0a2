# SPDX-License-Identifier: Apache-2.0
"""How a state moves: the one type that every plant, built in or a user's own, fulfils."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, inf
from typing import NamedTuple

import numpy as np

from kalman_ros.linear.arrays import Array
from kalman_ros.linear.discretize import Discretization

from .space import Space

#: The most steps of integration within one step of a model; a longer step is coarser.
MOST_SUBSTEPS = 10_000


@dataclass(frozen=True)
class Transition:
    """One step of sampled time, x' = F x + G u + w, w ~ N(0, Q): F (n, n), G (n, m), Q (n, n)."""

    F: Array
    G: Array
    Q: Array


class OperatingPoint(NamedTuple):
    """A state (n,) and an input (m,) about which a model is linearised."""

    state: Array
    input: Array


def numerical_jacobian(
    function: Callable[[Array], Array],
    x: Array,
    subtract: Callable[[Array, Array], Array] = np.subtract,
) -> Array:
    """Return d function / d x (k, n) at ``x`` (n,) by central differences.

    ``function`` takes (..., n); ``subtract`` is that of its output's space. The step is the
    cube root of the machine precision times the size of the coordinate, where truncation and
    rounding balance (Press et al., Numerical Recipes, section 5.7).
    """
    step = np.cbrt(np.finfo(float).eps) * np.maximum(1.0, np.abs(x))
    offsets = np.diag(step)
    change = subtract(function(x + offsets), function(x - offsets))
    return np.asarray((change / (2.0 * step[:, np.newaxis])).T)


def like(values: Array, points: Array) -> Array:
    """Repeat ``values`` (..., k) along the leading axes of ``points``."""
    if values.ndim >= points.ndim:
        return values
    return np.broadcast_to(values, (*points.shape[:-1], values.shape[-1]))


class Model(ABC):
    """A system dx/dt = derivative(x, u) + w, with w white noise.

    A subclass sets ``state`` and ``input`` and writes `derivative` and `noise_density`; all else
    has a default. Arrays may have any leading axes: x (..., n), u (..., m).
    """

    state: Space
    input: Space
    #: The longest step of the integrator, in seconds; `step` divides longer ones, into no more
    #: than 10 000 parts, so that a stray stamp cannot keep it busy for ever.
    max_step: float = inf

    @abstractmethod
    def derivative(self, x: Array, u: Array) -> Array:
        """Return dx/dt (..., n)."""

    @abstractmethod
    def noise_density(self, x: Array) -> Array:
        """Return the spectral density W (n, n) of the process noise at ``x`` (n,).

        Its units are those of the state, squared, per second: over a short dt the noise adds
        the covariance W dt.
        """

    def __repr__(self) -> str:
        return f'{type(self).__name__}(state: {self.state}; input: {self.input})'

    @property
    def equilibrium(self) -> OperatingPoint:
        """Where it rests, with no noise: derivative(x, u) = 0; the origin by default."""
        return OperatingPoint(np.zeros(self.state.size), np.zeros(self.input.size))

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return A = d derivative / d x (n, n) at x (n,) and u (m,); numerical by default."""
        return numerical_jacobian(lambda points: self.derivative(points, like(u, points)), x)

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return B = d derivative / d u (n, m) at x (n,) and u (m,); numerical by default."""
        return numerical_jacobian(lambda points: self.derivative(like(x, points), points), u)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds with ``u`` held, without noise.

        A negative ``dt`` goes back in time.
        """
        u = like(u, x)
        substeps = max(1, ceil(min(abs(dt) / self.max_step, MOST_SUBSTEPS)))
        h = dt / substeps
        for _ in range(substeps):
            k1 = self.derivative(x, u)
            k2 = self.derivative(x + 0.5 * h * k1, u)
            k3 = self.derivative(x + 0.5 * h * k2, u)
            k4 = self.derivative(x + h * k3, u)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return self.state.wrap(x)

    def transition(self, x: Array, u: Array, dt: float) -> Transition:
        """Return the step of length ``dt``, linearised about x (n,) and u (m,)."""
        A = self.state_jacobian(x, u)
        B = self.input_jacobian(x, u)
        return Transition(*Discretization(A, B, self.noise_density(x))(dt))
