# SPDX-License-Identifier: Apache-2.0
"""Motion of a state by steps: the common base of models in continuous and discrete time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import inf
from typing import Any, NamedTuple, Optional

import numpy as np

from kalman_ros.linear.batched import factor, semidefinite_factor, times
from kalman_ros.linear.kernels import corrected_moments, kernels
from kalman_ros.linear.matrices import Array

from .gaussian import Gaussian, unchecked
from .ordered_data import FirstSteps, OrderedData, StepMatrices
from .space import Space


class Transition(NamedTuple):
    """One step of sampled time, x' = F x + G u + w, w ~ N(0, Q): F (n, n), G (n, m), Q (n, n)."""

    F: Array
    G: Array
    Q: Array


class LinearizedStep(NamedTuple):
    """A step x' (..., n) with its linearisation: dx' = F dx + w, w ~ N(0, Q), both (..., n, n)."""

    state: Array
    F: Array
    Q: Array


class OperatingPoint(NamedTuple):
    """A state and an input about which a model is linearised.

    Parameters
    ----------
    state
        (n,).
    input
        (m,).

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.load('cart_pole').model.equilibrium.input
    array([0.])
    """

    state: Array
    input: Array


#: A mean (..., n) and covariance (..., n, n) after a reading, its innovation (..., k) and S
#: (..., k, k), the gain K (..., n, k), H (..., k, n), the normalised innovation squared, None
#: if it is not known, and whether mean and covariance are known to be finite and definite. A plain
#: tuple, since one with names takes half a microsecond.
CorrectedMoments = tuple[Array, Array, Array, Array, Array, Array, Optional[float], bool]


class Dynamics(ABC):
    """A system whose state moves by steps, x' = step(x, u, dt) + w, w ~ N(0, Q).

    It is a `Model`, in continuous time, or a `DiscreteModel`. Arrays may have any leading axes: x
    (..., n), u (..., m).
    """

    state: Space
    input: Space
    #: Longest step of the integrator, in seconds; `step` divides longer ones, into at most
    #: 10 000 parts, so that a wrong stamp cannot block it.
    max_step: float = inf
    #: Whether a step is x' = F x + G u + w, whatever x and u are: see `LinearSystem.sampled`.
    is_linear: bool = False
    #: Whether steps are whole periods, and there is no derivative.
    is_discrete: bool = False
    #: Seconds from one step to the next, in discrete time.
    period: float = 0.0

    def __repr__(self) -> str:
        return f'{type(self).__name__}(state: {self.state}; input: {self.input})'

    @property
    def equilibrium(self) -> OperatingPoint:
        """Operating point at which the model rests without noise; the origin by default."""
        return OperatingPoint(np.zeros(self.state.size), np.zeros(self.input.size))

    @property
    def input_scale(self) -> tuple[float, ...]:
        """True values of the input by those of its readings (m,); empty where they are alike."""
        return ()

    @abstractmethod
    def noise_density(self, x: Array) -> Array:
        """Return the spectral density W (n, n) of the process noise at ``x`` (n,)."""

    @abstractmethod
    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds with ``u`` held, without noise."""

    @abstractmethod
    def transition(self, x: Array, u: Array, dt: float) -> Transition:
        """Return the step of length ``dt``, linearised about x (n,) and u (m,)."""

    def time_derivative(self, x: Array, u: Array) -> Array:
        """Return the rate of change of the state (..., n): over a period, in discrete time."""
        return self.state.subtract(self.step(x, u, self.period), x) / self.period

    def nearest_step(self, dt: float) -> float:
        """Return the length nearest to ``dt`` that a step can have: ``dt`` in continuous time."""
        return dt

    def periods(self, dt: float) -> int:
        """Return the number of periods in ``dt`` seconds; 0 in continuous time.

        Raises
        ------
        ValueError
            If the number is not whole.
        """
        return 0

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the state after a step from x (n,) with u (m,), with the step's F and Q."""
        transition = self.transition(x, u, dt)
        return LinearizedStep(self.step(x, u, dt), transition.F, transition.Q)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return the covariance Q (n, n) that the noise adds in a step ``dt`` from x (n,)."""
        return self.transition(x, u, dt).Q

    def predicted_moments(
        self, x: Array, P: Array, u: Array, dt: float, number: int = 1
    ) -> Gaussian:
        """Return the state after steps of length ``dt``, and F P F' + Q of each, in turn."""
        for _ in range(number):
            x, F, Q = self.linearized_step(x, u, dt)
            P = kernels(x).sandwich(F, P, Q)
        return unchecked((x, P))

    def noisy_step(self, x: Array, u: Array, dt: float, normal: Array) -> Array:
        """Return the states (..., n) after a step with the noise of standard normal numbers."""
        L = semidefinite_factor(self.step_noise(x, u, dt))
        return self.state.add(self.step(x, u, dt), times(L, normal))

    def filter_pass(
        self,
        belief: tuple[Array, Array],
        data: OrderedData,
        parts: Any,
        sensors: Sequence[Any],
        limits: Sequence[float],
        kept: bool = True,
    ) -> StepMatrices | None:
        """Return the matrices of an extended Kalman filter that processes data in order.

        None, the default, where that is not possible at once, or a step fails.

        Parameters
        ----------
        belief
            Mean (n,) and covariance (n, n) at the first instant.
        data
            Inputs and readings.
        parts
            Parts into which each step is divided (S,).
        sensors, limits
            The sensors, and the largest NIS at which a reading of each is fused.
        kept
            Whether more is wanted than innovations, their covariances and the belief at the end.
        """
        return None

    @property
    def has_first_steps(self) -> bool:
        """Whether it has `first_steps`."""
        return False

    def first_steps(
        self,
        belief: tuple[Array, Array],
        data: OrderedData,
        parts: Any,
        sensors: Sequence[Any],
        limits: Sequence[float],
    ) -> FirstSteps | None:
        """Return the steps of `filter_pass` before a reading beyond its limit, or one that fails.

        None, the default, where that is not possible at once.
        """
        return None

    def corrected(self, x: Array, P: Array, y: Array, sensor: Any) -> CorrectedMoments:
        """Return the belief x, P after a reading y (..., k) of a sensor, with what led there.

        The sensor is linearised about x (..., n).

        Raises
        ------
        numpy.linalg.LinAlgError
            If a single S is not positive definite; of several, its results are NaN.
        """
        H, R = sensor.jacobian(x), sensor.covariance
        innovation = sensor.output.subtract(y, sensor.measure(x))
        mean, covariance, K, S, nis = self.corrected_moments(x, P, H, R, innovation)
        mean, covariance = self.state.arrived(mean, x, covariance)
        return mean, covariance, innovation, S, K, H, nis, False

    #: The mean and covariance after an innovation, for any leading axes.
    corrected_moments = staticmethod(corrected_moments)
    #: L with L L' = P (..., n, n), NaN where P is not positive definite.
    covariance_factor = staticmethod(factor)

    def step_noise(self, x: Array, u: Array, dt: float) -> Array:
        """Return the Q of `linearized_step`."""
        return self.linearized_step(x, u, dt).Q


class LinearDynamics(Dynamics):
    """A system whose step is x' = F x + G u + w, whatever x and u are."""

    is_linear = True

    @abstractmethod
    def sampled(self, dt: float) -> Transition:
        """Return the exact step of length ``dt``."""

    def predicted_moments(
        self, x: Array, P: Array, u: Array, dt: float, number: int = 1
    ) -> Gaussian:
        """Return F x + G u and F P F' + Q after steps of length ``dt``, in turn."""
        k, (F, G, Q) = kernels(x), self.sampled(dt)
        for _ in range(number):
            x, P = self.state.wrap(k.affine(F, x, G, u)), k.sandwich(F, P, Q)
        return unchecked((x, P))
