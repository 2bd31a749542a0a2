# SPDX-License-Identifier: Apache-2.0
"""Models in discrete time: x' = f(x, u) + w, once every period."""

from __future__ import annotations

from abc import abstractmethod
from math import inf

import numpy as np

from kalman_ros.linear.matrices import Array, ArrayLike, matrix, semidefinite, symmetric

from .dynamics import Dynamics, LinearDynamics, Transition
from .model import like, numerical_jacobian
from .space import Space, no_rotation

#: A step may differ from a whole number of periods by this fraction of one; stamps are rounded.
TOLERANCE = 1e-3
#: A rate is one over the period up to this share of it.
_SAME = 1e-6
#: The most periods of a step; after a longer gap an estimator restarts.
MOST_PERIODS = 100_000


class DiscreteModel(Dynamics):
    """A system x' = next(x, u) + w with w ~ N(0, noise(x)), one step every ``period`` seconds.

    A subclass sets ``state`` and ``input``, and ``period`` unless that is 1 s, and defines `next`
    and `noise`. A longer step repeats `next`. Arrays may have any leading axes.

    Examples
    --------
    >>> import numpy as np
    >>> import kalman_ros as kr
    >>> class Logistic(kr.DiscreteModel):
    ...     state, input, period = kr.Space(('share',), ('',)), kr.Space((), ()), 1.0
    ...
    ...     def next(self, x, u):
    ...         return 2.5 * x * (1.0 - x)
    ...
    ...     def noise(self, x):
    ...         return np.array([[1e-4]])
    >>> Logistic().step(np.array([0.5]), np.zeros(0), 1.0)
    array([0.625])
    """

    is_discrete = True
    #: Seconds from one step to the next.
    period: float = 1.0

    @abstractmethod
    def next(self, x: Array, u: Array) -> Array:
        """Return the state (..., n) one period after ``x`` (..., n), with ``u`` (..., m) held."""

    @abstractmethod
    def noise(self, x: Array) -> Array:
        """Return the covariance Q (n, n) that the noise adds in one period from ``x`` (n,)."""

    def next_jacobian(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Return F = d next / d x (n, n) and G = d next / d u (n, m); numerical by default."""
        difference = self.state.subtract
        F = numerical_jacobian(
            lambda points: self.next(points, like(u, points)), x, difference, self.state
        )
        if not u.size:
            return F, np.zeros((x.size, 0))
        G = numerical_jacobian(lambda points: self.next(like(x, points), points), u, difference)
        return F, G

    def noise_density(self, x: Array) -> Array:
        """Return the covariance of one period divided by the period."""
        return np.asarray(self.noise(x) / self.period)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds, a whole number of periods."""
        u = like(u, x)
        for _ in range(self.periods(dt)):
            x = self.state.wrap(self.next(x, u))
        return x

    def transition(self, x: Array, u: Array, dt: float) -> Transition:
        """Return the step of length ``dt``, linearised along the way from x (n,) with u (m,)."""
        n = x.size
        F, G, Q = np.eye(n), np.zeros((n, u.size)), np.zeros((n, n))
        for _ in range(self.periods(dt)):
            F_1, G_1 = self.next_jacobian(x, u)
            F, G, Q = F_1 @ F, F_1 @ G + G_1, symmetric(F_1 @ Q @ F_1.T + self.noise(x))
            x = self.state.wrap(self.next(x, u))
        return Transition(F, G, Q)

    def nearest_step(self, dt: float) -> float:
        """Return ``dt`` rounded to whole periods."""
        return self.period * round(dt / self.period)

    def periods(self, dt: float) -> int:
        """Return the number of periods in ``dt`` seconds.

        Raises
        ------
        ValueError
            If the number is not whole, is negative, or is more than 100 000.
        """
        count = round(dt / self.period)
        if not 0 <= count <= MOST_PERIODS or abs(dt / self.period - count) > TOLERANCE:
            raise ValueError(
                f'time: expected steps that are whole numbers of {self.period:g} s, the period '
                f'of the model, and at most {MOST_PERIODS} of them, got {dt:g} s'
            )
        return count


class DiscreteLinearSystem(LinearDynamics, DiscreteModel):
    """x' = F x + G u + w, w ~ N(0, Q), once every ``period`` seconds.

    Parameters
    ----------
    F, G, Q
        State matrix (n, n), input matrix (n, m) and noise covariance (n, n).
    state, input
        Spaces of x and u.
    period
        Period in seconds.

    Raises
    ------
    ValueError
        If a matrix has the wrong shape, is not finite, or Q is not positive semi-definite; or if
        the state has rotations, whose motion is never linear.
    """

    def __init__(
        self,
        F: ArrayLike,
        G: ArrayLike,
        Q: ArrayLike,
        state: Space,
        input: Space,
        period: float = 1.0,
    ) -> None:
        n, m = state.size, input.size
        no_rotation(state)
        self.state, self.input, self.period = state, input, period
        self.F, self.G = matrix('F', F, (n, n)), matrix('G', G, (n, m))
        self.Q = semidefinite('Q', Q, n)
        self._sampled = {1: Transition(self.F, self.G, self.Q)}

    def __repr__(self) -> str:
        matrices = f'F: {self.F.tolist()}; G: {self.G.tolist()}; Q: {self.Q.tolist()}'
        return f'{super().__repr__()[:-1]}; {matrices}; period: {self.period:g} s)'

    def next(self, x: Array, u: Array) -> Array:
        """Return F x + G u."""
        return np.asarray(x @ self.F.T + u @ self.G.T)

    def noise(self, x: Array) -> Array:
        """Return Q."""
        return self.Q

    def next_jacobian(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Return F and G."""
        return self.F, self.G

    def transition(self, x: Array, u: Array, dt: float) -> Transition:
        """Return the step; x and u do not matter."""
        return self.sampled(dt)

    def sampled(self, dt: float) -> Transition:
        """Return the step of length ``dt``, cached for the next call."""
        count = self.periods(dt)
        if count not in self._sampled:
            n, m = self.G.shape
            self._sampled[count] = super().transition(np.zeros(n), np.zeros(m), dt)
        return self._sampled[count]


def check_rate(model: Dynamics, rate: float) -> None:
    """Raise ValueError if the steps of a loop are not those of a model in discrete time."""
    if model.is_discrete and abs(rate * model.period - 1.0) > _SAME:
        raise ValueError(
            f'rate: expected {1.0 / model.period:g}, one step for each period of the model of '
            f'{model.period:g} s, got {rate:g}'
        )


def check_period(model: Dynamics) -> None:
    """Raise ValueError if the period of a model in discrete time is not a positive number."""
    period: object = model.period
    number = isinstance(period, (int, float)) and not isinstance(period, bool)
    if not number or not 0.0 < model.period < inf:
        raise ValueError(f'model: its period: expected seconds, more than 0, got {period!r}')
