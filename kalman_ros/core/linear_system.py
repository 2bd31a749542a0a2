# SPDX-License-Identifier: Apache-2.0
"""The linear model, for which every step is exact."""

from __future__ import annotations

import numpy as np

from kalman_ros.linear.discretize import Discretization
from kalman_ros.linear.matrices import Array, ArrayLike, matrix, semidefinite

from .dynamics import Dynamics, LinearDynamics, Transition
from .model import Model, in_continuous_time
from .space import Space, no_rotation

#: Number of step lengths that are cached; sampled loops use one or a few.
_REMEMBERED = 64


class LinearSystem(LinearDynamics, Model):
    """dx/dt = A x + B u + w, with w white noise of spectral density W.

    Parameters
    ----------
    A, B
        State matrix (n, n) and input matrix (n, m).
    W
        Spectral density of the process noise (n, n), symmetric positive semi-definite.
    state, input
        Spaces of x and u.

    Raises
    ------
    ValueError
        If a matrix has the wrong shape, is not finite, or W is not positive semi-definite; or if
        the state has rotations, whose motion is never linear.
    """

    def __init__(
        self, A: ArrayLike, B: ArrayLike, W: ArrayLike, state: Space, input: Space
    ) -> None:
        n, m = state.size, input.size
        no_rotation(state)
        self.state, self.input = state, input
        self.A = matrix('A', A, (n, n))
        self.B = matrix('B', B, (n, m))
        self.W = semidefinite('W', W, n)
        self._discretization = Discretization(self.A, self.B, self.W)
        self._transitions: dict[float, Transition] = {}

    def __repr__(self) -> str:
        matrices = f'A: {self.A.tolist()}; B: {self.B.tolist()}; W: {self.W.tolist()}'
        return f'{super().__repr__()[:-1]}; {matrices})'

    def derivative(self, x: Array, u: Array) -> Array:
        """Return A x + B u."""
        return np.asarray(x @ self.A.T + u @ self.B.T)

    def noise_density(self, x: Array) -> Array:
        """Return W."""
        return self.W

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return A."""
        return self.A

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return B."""
        return self.B

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the exact state after ``dt`` with ``u`` held."""
        sampled = self.sampled(dt)
        return self.state.wrap(x.dot(sampled.F.T) + u.dot(sampled.G.T))

    def transition(self, x: Array, u: Array, dt: float) -> Transition:
        """Return the exact step; x and u do not matter."""
        return self.sampled(dt)

    @property
    def series(self) -> tuple[float, Array]:
        """The terms of which `sampled` is the sum: see `Discretization.series`."""
        return self._discretization.series

    def sampled(self, dt: float) -> Transition:
        """Return the exact step of length ``dt``, cached for the next call."""
        known = self._transitions.get(dt)
        if known is None:
            if len(self._transitions) >= _REMEMBERED:
                self._transitions.clear()
            known = self._transitions[dt] = Transition(*self._discretization(dt))
        return known


def linearize(model: Dynamics, x: Array, u: Array) -> LinearSystem:
    """Return the linear system of small deviations from ``x`` (n,) and ``u`` (m,).

    Raises
    ------
    ValueError
        If the model is in discrete time.
    """
    model = in_continuous_time(model)
    A, B = model.state_jacobian(x, u), model.input_jacobian(x, u)
    return LinearSystem(A, B, model.noise_density(x), model.state.tangent, model.input)
