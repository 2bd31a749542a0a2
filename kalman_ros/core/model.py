# SPDX-License-Identifier: Apache-2.0
"""Motion of a state: the type that every plant implements, built-in or user-defined."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from functools import lru_cache
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.linear.discretize import Discretization, noise_integral
from kalman_ros.linear.matrices import Array
from kalman_ros.linear.views import coordinates, entries_last

from .dynamics import Dynamics, LinearizedStep, Transition
from .space import Space

#: Largest number of integration steps within one step of a model; a longer step is coarser.
MOST_SUBSTEPS = 10_000


_PRECISION = float(np.finfo(float).eps)
#: Step of differences, relative to the size of a coordinate: the cube root of the machine
#: precision, where truncation and rounding balance (Press et al., Numerical Recipes, section 5.7).
_DIFFERENCE = _PRECISION ** (1.0 / 3.0)
#: The same for differences of a step: the fourth root. Their truncation is small, since a step is
#: close to x, and their rounding is 1e-12, so that a batch, computed in another order, agrees.
_DIFFERENCE_OF_STEPS = _PRECISION**0.25


#: A space without rotations, of any size.
_PLAIN = Space(())


@lru_cache(maxsize=64)
def _directions(n: int) -> Array:
    """Return the points at which differences of n coordinates are taken (n, 2n + 1).

    The first is the centre; the points above it, and then those below it, follow.
    """
    return np.hstack((np.zeros((n, 1)), np.eye(n), -np.eye(n)))


class Differences(NamedTuple):
    """The points about ``x`` (..., n) from which central differences are taken.

    The leading axes of ``x`` may be any; its coordinates come first in memory, so that each is
    contiguous.

    Parameters
    ----------
    points
        Points (2n + 1, ..., n), the first of which is ``x``.
    step
        Distance of the other points (n, ...).
    """

    points: Array
    step: Array

    @staticmethod
    def about(x: Array, share: float = _DIFFERENCE, space: Space = _PLAIN) -> Differences:
        """Return the points about ``x``, at a ``share`` of the size of its coordinates."""
        parts = coordinates(x)
        step = share * np.maximum(1.0, np.abs(parts))
        n = len(step)
        directions = _directions(n).reshape(n, 2 * n + 1, *(1,) * (step.ndim - 1))
        points = parts[:, np.newaxis] + directions * step[:, np.newaxis]
        return Differences(space.reached(points.transpose((*range(1, points.ndim), 0)), x), step)

    def jacobian(
        self, values: Array, subtract: Callable[[Array, Array], Array] = np.subtract
    ) -> Array:
        """Return the derivative (..., k, n) of a function with ``values`` (2n + 1, ..., k)."""
        n = len(self.step)
        change = subtract(values[1 : n + 1], values[n + 1 :])
        if change.ndim == 2:
            return np.asarray((change / (2.0 * self.step[:, np.newaxis])).T)
        by_coordinate = coordinates(change) / (2.0 * self.step)
        return entries_last(by_coordinate)


def numerical_jacobian(
    function: Callable[[Array], Array],
    x: Array,
    subtract: Callable[[Array, Array], Array] = np.subtract,
    space: Space = _PLAIN,
) -> Array:
    """Return d function / d x (..., k, n) at ``x`` (..., n) by central differences, in one call.

    ``function`` takes (..., n), points of a ``space`` that matters only if it has rotations;
    ``subtract`` is the method of its output's space.
    """
    differences = Differences.about(x, space=space)
    return differences.jacobian(function(differences.points), subtract)


def like(values: Array, points: Array) -> Array:
    """Repeat ``values`` (..., k) along the leading axes of ``points``."""
    if values.ndim >= points.ndim:
        return values
    repeated = np.empty((*points.shape[:-1], values.shape[-1]))
    repeated[:] = values  # ten times as fast as `broadcast_to`
    return repeated


class Model(Dynamics):
    """A system dx/dt = derivative(x, u) + w, with w white noise.

    A subclass sets ``state`` and ``input`` and defines `derivative` and `noise_density`; all else
    has a default. Arrays may have any leading axes: x (..., n), u (..., m). For a rotation, dx/dt
    is the angular rate in the axes of the world, in which noise and errors are, too. The model
    rests where derivative(x, u) = 0, its `equilibrium`.

    Examples
    --------
    >>> import numpy as np
    >>> import kalman_ros as kr
    >>> class Pendulum(kr.Model):
    ...     state = kr.Space(('angle', 'rate'), ('rad', 'rad/s'), angles=('angle',))
    ...     input = kr.Space((), ())
    ...
    ...     def derivative(self, x, u):
    ...         return np.stack([x[..., 1], -9.81 * np.sin(x[..., 0])], axis=-1)
    ...
    ...     def noise_density(self, x):
    ...         return np.diag([0.0, 0.1])
    >>> Pendulum().step(np.array([0.1, 0.0]), np.zeros(0), 0.1).round(3)
    array([ 0.095, -0.096])
    """

    @abstractmethod
    def derivative(self, x: Array, u: Array) -> Array:
        """Return dx/dt (..., n)."""

    @abstractmethod
    def noise_density(self, x: Array) -> Array:
        """Return the spectral density W (n, n) of the process noise at ``x`` (n,).

        Its units are the squared units of the state per second: over a short dt the noise adds the
        covariance W dt.
        """

    def time_derivative(self, x: Array, u: Array) -> Array:
        """Return dx/dt (..., n)."""
        return self.derivative(x, u)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return A (n, n) at x (n,) and u (m,), for small errors; numerical by default.

        A is d derivative / d x, plus the cross product with the rate for a rotation.
        """
        differences = Differences.about(x, space=self.state)
        rates = self.derivative(differences.points, like(u, differences.points))
        return self.state.of_errors(differences.jacobian(rates), rates[0])

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return B = d derivative / d u (n, m) at x (n,) and u (m,); numerical by default."""
        if not len(u):
            return np.zeros((self.state.size, 0))
        return numerical_jacobian(lambda points: self.derivative(like(x, points), points), u)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds with ``u`` held, without noise.

        A negative ``dt`` integrates backwards.
        """
        u = like(u, x)
        count = self.substeps(dt)
        h = dt / count
        for _ in range(count):
            x = self.substep(x, u, h)
        return self.state.wrap(x)

    def substeps(self, dt: float) -> int:
        """Return the number of integration steps in ``dt`` seconds."""
        return max(1, ceil(min(abs(dt) / self.max_step, MOST_SUBSTEPS)))

    def substep(self, x: Array, u: Array, h: float) -> Array:
        """Return the state (..., n), not wrapped, after one integration step of ``h`` seconds.

        The classical method of Runge and Kutta, of fourth order; on rotations that of Munthe-Kaas.
        """
        state, derivative = self.state, self.derivative

        def rate(d: Array) -> Array:
            """Return the rate of change of ``d``, the difference from ``x``."""
            return state.pulled_back(d, derivative(state.reached(x + d, x), u))

        k1 = derivative(x, u)
        k2 = rate(0.5 * h * k1)
        k3 = rate(0.5 * h * k2)
        k4 = rate(h * k3)
        return state.reached(x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), x)

    @property
    def analytic(self) -> bool:
        """Whether the class defines its linearisation, which is numerical otherwise."""
        kind = type(self)
        has_jacobian = kind.state_jacobian is not Model.state_jacobian
        return has_jacobian or kind.transition is not Model.transition

    def transition(self, x: Array, u: Array, dt: float) -> Transition:
        """Return the step of length ``dt``, linearised about x (n,) and u (m,).

        Where a model has no analytic Jacobian, F and G are the derivatives of `step`.
        """
        if self.analytic:
            A, B = self.state_jacobian(x, u), self.input_jacobian(x, u)
            return Transition(*Discretization(A, B, self.noise_density(x), longest=dt)(dt))
        moved = self.linearized_step(x, u, dt)
        G = numerical_jacobian(
            lambda points: self.step(like(x, points), points, dt), u, self.state.subtract
        )
        return Transition(moved.F, G, moved.Q)

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the state after a step from x (n,) with u (m,), with the step's F and Q."""
        if self.analytic:
            return super().linearized_step(x, u, dt)
        moved, F, A = self.differenced_step(x, u, dt)
        return LinearizedStep(moved, F, noise_integral(A, self.noise_density(x), dt))

    def differenced_step(self, x: Array, u: Array, dt: float) -> tuple[Array, Array, Array]:
        """Return the state x' (..., n) after a step, F = d x' / d x and A, both (..., n, n).

        All three are computed from the points about x (..., n).
        """
        differences = Differences.about(x, _DIFFERENCE_OF_STEPS, self.state)
        points = differences.points
        moved, slope = self.step(points, u, dt), self.derivative(points, like(u, points))
        F = differences.jacobian(moved, self.state.subtract)
        A = self.state.of_errors(differences.jacobian(slope), slope[0])
        return moved[0], F, A

    def differenced_slope(self, x: Array, u: Array) -> Array:
        """Return only the A (..., n, n) of `differenced_step`."""
        differences = Differences.about(x, _DIFFERENCE_OF_STEPS, self.state)
        points = differences.points
        slope = self.derivative(points, like(u, points))
        return self.state.of_errors(differences.jacobian(slope), slope[0])

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return the covariance Q (n, n) that the noise adds in a step ``dt`` from x (n,)."""
        if self.analytic:
            return super().noise_covariance(x, u, dt)
        return noise_integral(self.state_jacobian(x, u), self.noise_density(x), dt)


def in_continuous_time(model: Dynamics) -> Model:
    """Return the model, which has a derivative; ValueError if it is in discrete time."""
    if model.is_discrete:
        kind = type(model).__name__
        raise ValueError(f'model: {kind} is in discrete time, without a derivative')
    continuous: Any = model
    return continuous  # type: ignore[no-any-return]
