# SPDX-License-Identifier: Apache-2.0
"""The filters of filterpy behind the interface of this package, as a cross-check."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, ClassVar, TypeVar

import numpy as np
from filterpy.kalman import (
    ExtendedKalmanFilter,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)

from kalman_ros.core import Array, Dynamics, Gaussian, Sensor, symmetric

from .filter import Correction, Filter
from .filters.ukf import Alpha, Beta, Kappa
from .plan import Plan, carried, parts

R = TypeVar('R')


def _correction(peer: Any, innovation: Array) -> Correction:
    S = np.asarray(peer.S, dtype=float)
    posterior = Gaussian(np.array(peer.x, dtype=float), symmetric(np.array(peer.P)))
    return Correction(posterior, innovation, S)


def _sound(method: Callable[..., R]) -> Callable[..., R]:
    """Wrap a method so that numpy errors replace filterpy's for values that are not finite."""

    @wraps(method)
    def sound(*arguments: Any) -> R:
        try:
            return method(*arguments)
        except ValueError as error:
            raise np.linalg.LinAlgError(str(error)) from None

    return sound


class _Kalman(Filter):
    """filterpy's Kalman filter."""

    _kind: ClassVar[Callable[..., Any]] = KalmanFilter

    def __init__(self, model: Dynamics) -> None:
        self.model = model

    def _peer(self, belief: Gaussian, k: int) -> Any:
        peer = self._kind(dim_x=len(belief.mean), dim_z=k)
        peer.x, peer.P = belief.mean.copy(), belief.covariance.copy()
        return peer

    @_sound
    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Predict with filterpy, in steps as short as the steps of the native filters."""
        count = 1 if self._kind is KalmanFilter else parts(self.model, dt)
        for _ in range(count):
            belief = self._predicted(belief, u, dt / count)
        return belief

    def _predicted(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        step = self.model.transition(belief.mean, u, dt)
        peer = self._peer(belief, 1)
        peer.F, peer.Q, peer.B = step.F, step.Q, step.G
        peer.predict(u=u)
        mean = np.array(peer.x, dtype=float)
        if self._kind is ExtendedKalmanFilter:
            # filterpy leaves the nonlinear step to a subclass, and takes F x + G u without one
            mean = self.model.step(belief.mean, u, dt)
        return Gaussian(mean, symmetric(np.array(peer.P)))

    @_sound
    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Update with filterpy."""
        x, space = belief.mean, sensor.output
        peer = self._peer(belief, len(y))
        peer.R = sensor.covariance
        innovation = space.subtract(y, sensor.measure(x))
        if self._kind is KalmanFilter:
            peer.H = sensor.jacobian(x)
            peer.update(y)
        else:
            peer.update(y, sensor.jacobian, sensor.measure, residual=space.subtract)
        peer.x = self.model.state.wrap(peer.x)
        return _correction(peer, innovation)


class _Extended(_Kalman):
    """filterpy's extended Kalman filter."""

    _kind = ExtendedKalmanFilter


class _Unscented(Filter):
    """filterpy's unscented Kalman filter."""

    @classmethod
    def build(
        cls, plan: Plan, alpha: Alpha = 1.0, beta: Beta = 0.0, kappa: Kappa = 1.0
    ) -> _Unscented:
        """Return the filter of any model."""
        return cls(plan.model, alpha, beta, kappa)

    def __init__(self, model: Dynamics, alpha: float, beta: float, kappa: float) -> None:
        self.model, state = model, model.state
        self._points = MerweScaledSigmaPoints(state.size, alpha, beta, kappa, subtract=np.subtract)

    def _peer(self, belief: Gaussian, sensor: Sensor | None) -> Any:
        state = self.model.state
        peer = UnscentedKalmanFilter(
            dim_x=state.size,
            dim_z=1 if sensor is None else sensor.output.size,
            dt=0.0,
            hx=None if sensor is None else sensor.measure,
            fx=None,
            points=self._points,
            x_mean_fn=state.mean,
            residual_x=state.subtract,
            z_mean_fn=None if sensor is None else sensor.output.mean,
            residual_z=None if sensor is None else sensor.output.subtract,
        )
        peer.x, peer.P = belief.mean.copy(), belief.covariance.copy()
        return peer

    @_sound
    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Predict with filterpy."""
        peer = self._peer(belief, None)
        _, peer.Q = carried(self.model, belief.mean[np.newaxis], u, dt)
        peer.predict(dt=dt, fx=lambda x, dt: self.model.step(x, u, dt))
        return Gaussian(np.array(peer.x), symmetric(np.array(peer.P)))

    @_sound
    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Update with filterpy."""
        peer = self._peer(belief, sensor)
        peer.R = sensor.covariance
        peer.sigmas_f = self._points.sigma_points(peer.x, peer.P)
        peer.update(y)
        peer.x = self.model.state.wrap(peer.x)
        return _correction(peer, np.asarray(peer.y))


PEERS: dict[str, type[Filter]] = {'kf': _Kalman, 'ekf': _Extended, 'ukf': _Unscented}
