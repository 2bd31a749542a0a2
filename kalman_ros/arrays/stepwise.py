# SPDX-License-Identifier: Apache-2.0
"""The filters for a loop of your own: one step, one reading at a time.

The mathematics is that of `kalman_ros.estimators`; what stands here converts and checks arguments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar

import numpy as np

from kalman_ros.core import Array, ArrayLike, Gaussian, Sensor
from kalman_ros.core.known_names import KnownNames
from kalman_ros.estimators.diffuse import Diffuse, begun
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.filters import ekf, kf, ukf

from .accept import belief_of, finite, seconds
from .rows import model_of, sensors_of


class Stepwise(KnownNames):
    """Conversion of arguments in front of a filter: no belief that is invalid goes in."""

    other_names: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(('x', 'x_post', 'x_prior'), "a belief's .mean: a filter keeps none"),
        **dict.fromkeys(('P', 'P_post', 'P_prior'), "a belief's .covariance: a filter keeps none"),
        **dict.fromkeys(('F', 'A', 'B', 'G', 'Q'), 'of .model'),
        **dict.fromkeys(('H', 'R'), 'of a sensor: correct(belief, y, (H, R))'),
        'update': '.correct(belief, y, (H, R)), whose result has .posterior',
        'batch_filter': 'kr.filter(model, sensors, times, readings)',
        **dict.fromkeys(('likelihood', 'log_likelihood'), '.log_likelihood of a correction'),
        **dict.fromkeys(('y', 'residual'), '.innovation of a correction'),
        **dict.fromkeys(('K', 'S'), '.gain and .innovation_covariance of a correction'),
    }

    model: Any

    def __new__(cls, *given: Any, **options: Any) -> Any:
        """Refuse the arguments of filterpy and others with those that there are here."""
        if len(given) > 1 and np.ndim(given[0]) == 2:
            raise TypeError(
                f'{cls.__name__}: expected a model, got matrices: '
                f'kr.{cls.__name__}(kr.discrete_model(F, G, Q)); readings go into '
                'correct(belief, y, (H, R))'
            )
        if not options.keys().isdisjoint(('dim_x', 'dim_z')):
            raise TypeError(
                f'{cls.__name__}: filterpy has dim_x and dim_z, here a filter has a model: '
                f'kr.{cls.__name__}(kr.discrete_model(F, G, Q)); belief and readings go into '
                'predict(belief, u) and correct(belief, y, (H, R))'
            )
        return super().__new__(cls)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'model', model_of(self.model))
        later = getattr(super(), '__post_init__', None)
        if later is not None:
            later()

    def predict(
        self, belief: Gaussian, u: ArrayLike | None = None, dt: float | None = None
    ) -> Gaussian:
        """Return the belief ``dt`` seconds later, with the input ``u`` held.

        Parameters
        ----------
        belief
            A `Gaussian`, or a pair of mean (n,) and covariance (n, n), a diagonal or a number.
        u
            (m,); zero by default.
        dt
            In seconds; by default the period of a model in discrete time.

        Raises
        ------
        ValueError
            If an argument is invalid; the message names it.
        """
        lower: Any = super()
        prior: Gaussian = lower.predict(self._belief(belief), self._input(u), self._seconds(dt))
        return prior

    def correct(self, belief: Gaussian, y: ArrayLike, sensor: Sensor) -> Correction:
        """Return what the reading ``y`` (k,) of a sensor makes of a belief.

        Parameters
        ----------
        belief
            As for `predict`.
        y
            The numbers of the reading (k,); skip a reading that is missing.
        sensor
            A `Sensor`, or a pair (H, R).

        Returns
        -------
        Correction
            Its ``posterior`` is the belief after the reading; ``innovation`` and ``nis`` show how
            well the reading agrees.

        Raises
        ------
        ValueError
            If an argument is invalid; the message names it.
        numpy.linalg.LinAlgError
            If the covariance of the innovation is not positive definite.
        """
        if not isinstance(sensor, Sensor):
            (sensor,) = sensors_of(sensor, self.model).values()
        sensor = sensor.of(self.model.state)
        if isinstance(self, kf.KalmanFilter) and not sensor.linear:
            raise ValueError(
                f'sensor: a Kalman filter needs a linear one, and {type(sensor).__name__} is not '
                'declared linear; ExtendedKalmanFilter and UnscentedKalmanFilter take any'
            )
        lower: Any = super()
        reading = finite('y', y, sensor.output.size)
        correction: Correction = lower.correct(self._belief(belief), reading, sensor)
        return correction

    def _belief(self, given: Any) -> Gaussian:
        n = self.model.state.size
        if isinstance(given, Diffuse):
            return given
        if type(given) is Gaussian and given.mean.shape == (n,):
            return given if isfinite(given.covariance.trace()) else begun(given)
        return begun(belief_of(given, self.model, 'belief'))

    def _input(self, u: ArrayLike | None) -> Array:
        if u is None:
            return np.zeros(self.model.input.size)
        return finite('u', u, self.model.input.size)

    def _seconds(self, dt: float | None) -> float:
        if dt is None and self.model.is_discrete:
            return float(self.model.period)
        return seconds('dt', dt)


@dataclass(frozen=True)
class KalmanFilter(Stepwise, kf.KalmanFilter):
    """The optimal estimator of a linear system with Gaussian noise.

    Steps are discretised exactly for their length, so readings may be irregular.

    Parameters
    ----------
    model
        A linear one: of `continuous_model` or `discrete_model`.

    Raises
    ------
    ValueError
        If the model is not linear.

    References
    ----------
    R. E. Kalman, A New Approach to Linear Filtering and Prediction Problems, 1960.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kalman = kr.KalmanFilter(kr.discrete_model(1.0, Q=0.2))
    >>> found = kalman.correct((10.0, 4.0), [12.0], ([[1.0]], 1.0))
    >>> found.posterior.mean.round(3), found.posterior.covariance.round(3)
    (array([11.6]), array([[0.8]]))
    >>> kalman.predict(found.posterior).covariance.round(3)
    array([[1.]])
    """


@dataclass(frozen=True)
class ExtendedKalmanFilter(Stepwise, ekf.ExtendedKalmanFilter):
    """A Kalman filter of a model and sensors that are linearised about the estimate.

    Parameters
    ----------
    model
        Any `Model`; a compiled one is some ten times as fast.

    References
    ----------
    Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation
    (2001), section 10.3.

    Examples
    --------
    >>> import numpy as np
    >>> import kalman_ros as kr
    >>> def pendulum(x):
    ...     return np.array([x[1], -9.81 * np.sin(x[0])])
    >>> model = kr.continuous_model(pendulum, W=[0.0, 0.1])
    >>> ekf = kr.ExtendedKalmanFilter(model)
    >>> belief = ekf.predict(([0.1, 0.0], 0.01), dt=0.1)
    >>> ekf.correct(belief, [0.05], ([1, 0], 0.01)).posterior.mean.round(3)
    array([ 0.074, -0.078])
    """


@dataclass(frozen=True)
class UnscentedKalmanFilter(Stepwise, ukf.UnscentedKalmanFilter):
    """A Kalman filter that passes 2n + 1 points through a model and its sensors.

    Parameters
    ----------
    model
        Any `Model`.
    alpha, beta, kappa
        Spread, knowledge of the distribution, and second spread of the points. With the defaults
        no weight is negative.

    Raises
    ------
    ValueError
        If n + kappa is not positive.

    References
    ----------
    R. van der Merwe, Sigma-Point Kalman Filters for Probabilistic Inference in Dynamic
    State-Space Models (2004), section 3.2.

    Examples
    --------
    >>> import numpy as np
    >>> import kalman_ros as kr
    >>> def pendulum(x):
    ...     return np.array([x[1], -9.81 * np.sin(x[0])])
    >>> model = kr.continuous_model(pendulum, W=[0.0, 0.1])
    >>> ukf = kr.UnscentedKalmanFilter(model)
    >>> ukf.predict(([0.1, 0.0], 0.01), dt=0.1).mean.round(3)
    array([ 0.095, -0.096])
    """
