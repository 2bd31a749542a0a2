# SPDX-License-Identifier: Apache-2.0
"""Filters: functions from belief to belief, without clock, history or mutation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log, pi
from typing import Any, ClassVar, NamedTuple

import numpy as np

from kalman_ros.core import (
    Array,
    Definite,
    Dynamics,
    Gaussian,
    Sensor,
    definite,
    is_finite,
    unchecked,
)
from kalman_ros.core.known_names import KnownNames
from kalman_ros.core.ordered_data import FirstSteps, OrderedData
from kalman_ros.core.stacked import stacked
from kalman_ros.linear.factor import cholesky
from kalman_ros.linear.kernels import kernels

from .diffuse import Diffuse, settled, update
from .plan import Plan


class Prediction(NamedTuple):
    """A belief after a step that maps errors by F (..., n, n) and adds noise of covariance Q."""

    belief: Gaussian
    F: Array
    Q: Array


class Correction(KnownNames):
    """A corrected belief with its innovation; with leading axes, many of them.

    Parameters
    ----------
    posterior
        Belief after the reading.
    innovation
        Reading minus its prediction (..., k).
    innovation_covariance
        S (..., k, k), the predicted covariance of the innovation.
    gain
        K (..., n, k), which maps the innovation to the change of the mean; None for a mixture.
    jacobian
        H (..., k, n), the sensor's Jacobian at the prior mean; None if the filter has none.
    nis
        Normalised innovation squared, if it is known.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kalman = kr.KalmanFilter(kr.discrete_model(1.0, Q=0.2))
    >>> found = kalman.correct((10.0, 4.0), [12.0], ([[1.0]], 1.0))
    >>> found
    Correction(innovation [2.], NIS 0.8 of 1, mean [11.6])
    >>> found.gain.round(2)
    array([[0.8]])
    """

    __slots__ = ('_nis', 'gain', 'innovation', 'innovation_covariance', 'jacobian', 'posterior')
    other_names: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(('x', 'x_post', 'mean'), '.posterior.mean'),
        **dict.fromkeys(('P', 'P_post', 'covariance'), '.posterior.covariance'),
        **dict.fromkeys(('y', 'residual'), '.innovation'),
        'S': '.innovation_covariance',
        'K': '.gain',
        'H': '.jacobian',
        'likelihood': '.log_likelihood',
    }

    def __init__(
        self,
        posterior: Gaussian,
        innovation: Array,
        innovation_covariance: Array,
        gain: Array | None = None,
        jacobian: Array | None = None,
        nis: Any = None,
    ) -> None:
        self.posterior = posterior
        self.innovation = innovation
        self.innovation_covariance = innovation_covariance
        self.gain = gain
        self.jacobian = jacobian
        self._nis = nis

    @property
    def nis(self) -> Any:
        """The normalised innovation squared, innovation' S^-1 innovation (...,).

        It is chi-square with k degrees of freedom if the filter is consistent (Bar-Shalom, Li
        and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4).
        The value is infinite if S is not positive definite.
        """
        if self._nis is None:
            k = kernels(self.innovation)
            self._nis = k.weighed(self.innovation_covariance, self.innovation)
        return self._nis

    @property
    def log_likelihood(self) -> Any:
        """The log of the density of the reading (...,), by the prediction-error decomposition.

        A. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989),
        section 3.4.
        """
        S = self.innovation_covariance
        # a number takes a tenth of the time of a determinant
        if S.shape == (1, 1) and S[0, 0] > 0.0:
            return -0.5 * (self.nis + log(2.0 * pi * S[0, 0]))
        _, size = np.linalg.slogdet(2.0 * np.pi * S)
        return -0.5 * (self.nis + size)

    def with_posterior(self, posterior: Gaussian) -> Correction:
        """Return the same correction with another belief after it."""
        S, K, H = self.innovation_covariance, self.gain, self.jacobian
        return Correction(posterior, self.innovation, S, K, H, self._nis)

    def __repr__(self) -> str:
        """Return innovation and NIS, and the mean of the posterior."""
        shown = (np.array2string(a, precision=4) for a in (self.innovation, self.posterior.mean))
        innovation, mean = shown
        k = self.innovation.size
        return f'Correction(innovation {innovation}, NIS {self.nis:.4g} of {k}, mean {mean})'


class Filter(ABC):
    """A recursive estimator of the state of a model.

    Beliefs may have leading axes, means (..., n) and covariances (..., n, n), with inputs
    (..., m) and readings (..., k), for a model and sensors that take them (`core.stacked`). A
    covariance (n, n) that all members share stays shared. A member that fails becomes NaN; for a
    single belief a failure is an error. The class attributes describe the kind of filter.
    """

    model: Dynamics

    #: Whether the model and the sensors have to be linear, and the model in continuous time.
    needs_linear: ClassVar[bool] = False
    needs_continuous: ClassVar[bool] = False
    #: Whether no other gain has a smaller error; for a fixed gain, in steady state. The theory of
    #: the LQG loop holds for these filters.
    optimal: ClassVar[bool] = True
    #: Whether the filter has one constant gain for each sensor, by name in ``gains``.
    fixed_gain: ClassVar[bool] = False
    #: Whether beliefs are sums of Gaussians, which have no leading axes.
    mixture: ClassVar[bool] = False
    #: Whether readings are linearised about the prediction, however uncertain that is.
    linearises_once: ClassVar[bool] = False
    #: Whether the first belief may have infinite variances: see `diffuse`.
    diffuse: ClassVar[bool] = False

    @classmethod
    def build(cls, plan: Plan) -> Filter:
        """Return the filter of a plan; further arguments of a class are its options.

        Raises
        ------
        ValueError
            If the plan does not suit the filter; DesignError if the design has no solution.
        """
        constructor: Any = cls
        filter: Filter = constructor(plan.model)
        return filter

    @classmethod
    def placed_poles(cls, n: int, **options: Any) -> list[complex]:
        """Return the n poles in 1/s that a gain is designed for; empty for other designs."""
        return []

    @abstractmethod
    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return the belief ``dt`` seconds later, with the input ``u`` (m,) held."""

    @abstractmethod
    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return the belief corrected by the reading ``y`` (k,) of ``sensor``.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the innovation covariance is not positive definite.
        """

    @property
    def has_first_steps(self) -> bool:
        """Whether it has `first_steps`, for most readings."""
        return False

    def first_steps(
        self,
        belief: Gaussian,
        data: OrderedData,
        sensors: Sequence[Sensor],
        limits: Sequence[float],
    ) -> FirstSteps | None:
        """Return the steps through ordered data up to a reading that needs a decision, at once.

        The steps end before a reading whose NIS is beyond the limit of its sensor, and before one
        after which the belief is not positive definite. None, the default, where predictions and
        corrections have to be computed one by one.

        Parameters
        ----------
        belief
            Belief at the first instant, less its step.
        data
            Inputs and readings.
        sensors, limits
            The sensors, and the largest NIS of each.
        """
        return None

    def stacked(self) -> Filter:
        """Return the filter for beliefs with leading axes, even if its model takes one state."""
        single: Any = self
        batched: Filter = replace(single, model=stacked(self.model))
        return batched


class SmoothableFilter(Filter):
    """A filter whose steps are linear in the error, so that beliefs can be smoothed."""

    @abstractmethod
    def linearized(self, belief: Gaussian, u: Array, dt: float) -> Prediction:
        """Return what `predict` does, with the F and Q of the whole step."""


@dataclass(frozen=True)
class LinearUpdate(SmoothableFilter):
    """The update of filters that linearise a sensor about the mean.

    Parameters
    ----------
    model
        System model.
    """

    model: Dynamics
    linearises_once = True

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return x + K innovation, (I - K H) P (I - K H)' + K R K', with K = P H' S^-1."""
        if isinstance(belief, Diffuse):
            return self._begin(belief, y, sensor)
        mean, covariance, innovation, S, K, H, nis, known = self.model.corrected(
            *belief, y, sensor
        )
        posterior = (definite if known else unchecked)((mean, covariance))
        return Correction(posterior, innovation, S, K, H, nis)

    def _begin(self, belief: Diffuse, y: Array, sensor: Sensor) -> Correction:
        """Return the correction of a belief that knows nothing of some states."""
        x, space = belief.mean, self.model.state
        H, innovation = sensor.jacobian(x), sensor.output.subtract(y, sensor.measure(x))
        correction = update(belief, innovation, H, sensor.covariance)
        mean, known = space.arrived(x + correction.change, x, correction.known)
        _, unknown = space.arrived(x + correction.change, x, correction.unknown)
        after = settled(mean, known, unknown)
        return Correction(after, correction.innovation, correction.covariance, correction.gain, H)


def committed(belief: Gaussian) -> tuple[Gaussian, int]:
    """Return a finite and positive definite belief, and the number of repairs.

    Raises
    ------
    numpy.linalg.LinAlgError
        If that is impossible.
    """
    if isinstance(belief, (Definite, Diffuse)):
        return belief, 0
    if not is_finite(belief.mean):
        raise np.linalg.LinAlgError('the estimate is not finite')
    if belief.factor is not None and is_finite(belief.factor):
        return belief, 0  # L L' is definite, whatever rounding makes of it
    _, P, repairs = cholesky(belief.covariance)
    return (Gaussian(belief.mean, P) if repairs else belief), repairs
