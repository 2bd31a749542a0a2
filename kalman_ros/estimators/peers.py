# SPDX-License-Identifier: Apache-2.0
"""filterpy's classes behind our protocol, as a cross-check."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import numpy as np
from filterpy.kalman import (
    ExtendedKalmanFilter,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)

from kalman_ros.core import Array, Gaussian, Model, Sensor, symmetric

from .correction import Correction
from .filter import Plan, carried, linear_system, parts
from .ukf import Alpha, Beta, Kappa

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


class _Linearised:
    """filterpy's Kalman filter, plain or extended."""

    def __init__(self, plan: Plan, kind: Callable[..., Any]) -> None:
        self._model: Model = plan.model
        self._kind = kind

    def _peer(self, belief: Gaussian, k: int) -> Any:
        peer = self._kind(dim_x=len(belief.mean), dim_z=k)
        peer.x, peer.P = belief.mean.copy(), belief.covariance.copy()
        return peer

    @_sound
    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Predict with filterpy, in steps as short as those of our own filters."""
        count = 1 if self._kind is KalmanFilter else parts(self._model, dt)
        for _ in range(count):
            belief = self._moved(belief, u, dt / count)
        return belief

    def _moved(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        step = self._model.transition(belief.mean, u, dt)
        peer = self._peer(belief, 1)
        peer.F, peer.Q, peer.B = step.F, step.Q, step.G
        peer.predict(u=u)
        mean = np.array(peer.x, dtype=float)
        if self._kind is ExtendedKalmanFilter:
            # filterpy leaves the nonlinear step to a subclass, and takes F x + G u without one
            mean = self._model.step(belief.mean, u, dt)
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
        peer.x = self._model.state.wrap(peer.x)
        return _correction(peer, innovation)


class _Unscented:
    """filterpy's unscented Kalman filter."""

    def __init__(self, plan: Plan, alpha: float, beta: float, kappa: float) -> None:
        self._model: Model = plan.model
        state = plan.model.state
        self._points = MerweScaledSigmaPoints(state.size, alpha, beta, kappa, subtract=np.subtract)

    def _peer(self, belief: Gaussian, sensor: Sensor | None) -> Any:
        state = self._model.state
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
        _, peer.Q = carried(self._model, belief.mean[np.newaxis], u, dt)
        peer.predict(dt=dt, fx=lambda x, dt: self._model.step(x, u, dt))
        return Gaussian(np.array(peer.x), symmetric(np.array(peer.P)))

    @_sound
    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Update with filterpy."""
        peer = self._peer(belief, sensor)
        peer.R = sensor.covariance
        peer.sigmas_f = self._points.sigma_points(peer.x, peer.P)
        peer.update(y)
        peer.x = self._model.state.wrap(peer.x)
        return _correction(peer, np.asarray(peer.y))


def _kf(plan: Plan) -> _Linearised:
    linear_system('kf', plan)
    return _Linearised(plan, KalmanFilter)


def _ekf(plan: Plan) -> _Linearised:
    return _Linearised(plan, ExtendedKalmanFilter)


def _ukf(
    plan: Plan,
    alpha: Alpha = 1.0,
    beta: Beta = 0.0,
    kappa: Kappa = 1.0,
) -> _Unscented:
    return _Unscented(plan, alpha, beta, kappa)


BUILDERS: dict[str, Callable[..., Any]] = {'kf': _kf, 'ekf': _ekf, 'ukf': _ukf}
