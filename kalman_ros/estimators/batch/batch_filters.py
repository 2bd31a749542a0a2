# SPDX-License-Identifier: Apache-2.0
"""The filters for any number of beliefs at once: means (..., n), covariances (..., n, n).

Each is the filter of the same name for one belief, with the same equations; a test holds them
equal. Leading axes broadcast: a covariance that is the same for all members stays one matrix
(n, n), and then so are its gain and all that follows from it.

Nothing is raised for a member that fails: it becomes NaN, and its NIS infinite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, Space, unchecked
from kalman_ros.estimators.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.filter import Filter, parts
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.estimators.kf import KalmanFilter
from kalman_ros.estimators.ukf import UnscentedKalmanFilter
from kalman_ros.linear.batched import (
    divided,
    factor,
    joseph,
    product,
    product_transposed,
    repaired_factor,
    sandwich,
    symmetric,
    times,
)
from kalman_ros.linear.views import coordinates, coordinates_last

from .batch_correction import BatchCorrection
from .candidates import candidate_dynamics
from .dynamics import Dynamics, Readout

#: The filters, by name, that have a batched form.
BATCHED = ('kf', 'ekf', 'ukf', 'steady_state', 'luenberger')


class BatchFilter(Protocol):
    """A `Filter` whose beliefs have leading axes."""

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return the beliefs ``dt`` seconds later, with inputs ``u`` (..., m) held."""
        ...

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> BatchCorrection:
        """Return the beliefs corrected by readings ``y`` (..., k) of ``sensor``."""
        ...


class _Readouts:
    """The `Readout` of each sensor, made at its first reading."""

    def __init__(self) -> None:
        self._known: dict[int, Readout] = {}

    def __call__(self, sensor: Sensor) -> Readout:
        found = self._known.get(id(sensor))
        if found is None or found.sensor is not sensor:
            found = self._known[id(sensor)] = Readout(sensor)
        return found


@dataclass(frozen=True)
class BatchLinearUpdate:
    """KF and EKF: models and sensors linearised about the means."""

    dynamics: Dynamics
    _readouts: _Readouts = field(default_factory=_Readouts, init=False, repr=False)

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = step(x, u), P = F P F' + Q, in steps of the model's ``max_step``."""
        x, P = belief
        count = parts(self.dynamics.model, dt)
        for _ in range(count):
            x, P = self.dynamics.predicted(x, P, u, dt / count)
        return unchecked((x, symmetric(P)))

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> BatchCorrection:
        """Return x + K innovation, (I - K H) P (I - K H)' + K R K', with K = P H' S^-1."""
        x, P = belief
        H, R = self._readouts(sensor).jacobian(x), sensor.covariance
        innovation = sensor.output.subtract(y, sensor.measure(x))
        HP = product(H, P)
        S = symmetric(product_transposed(HP, H) + R)
        K = divided(HP, factor(S))
        state = self.dynamics.model.state
        moved = state.arrived(x + times(K, innovation), x, joseph(K, H, P, R))
        return BatchCorrection(unchecked(moved), innovation, S)


@dataclass(frozen=True)
class BatchFixedGain:
    """Observers with one gain L (n, k) for each sensor: steady-state and Luenberger."""

    observer: FixedGainObserver

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Return x = F x + G u, P = F P F' + Q."""
        x, P = belief
        step = self.observer.system.sampled(dt)
        F, G, Q = step.F, step.G, step.Q
        return unchecked((times(F, x) + times(G, u), symmetric(sandwich(F, P, Q))))

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> BatchCorrection:
        """Return x + L innovation, with the covariance of the error for this gain."""
        x, P = belief
        L, C, R = self.observer.gain(sensor), sensor.jacobian(x), sensor.covariance
        innovation = sensor.output.subtract(y, sensor.measure(x))
        mean = self.observer.system.state.wrap(x + times(L, innovation))
        posterior = unchecked((mean, joseph(L, C, P, R)))
        return BatchCorrection(posterior, innovation, symmetric(sandwich(C, P, R)))


@dataclass(frozen=True)
class BatchUnscented:
    """The unscented filter: 2n + 1 points for each belief, all moved in one call."""

    filter: UnscentedKalmanFilter
    dynamics: Dynamics

    def _points(self, x: Array, offsets: Array) -> Array:
        """Return the points (2n + 1, ..., n) for ``offsets`` (..., n, 2n + 1)."""
        if offsets.ndim == 2:
            offsets = offsets.reshape(*(1,) * (x.ndim - 1), *offsets.shape)
        return self.filter.model.state.reached(coordinates(offsets) + x, x)

    def _offsets(self, P: Array) -> Array:
        """Return the sigma points minus the mean (..., n, 2n + 1)."""
        return product(repaired_factor(P), self.filter.directions)

    def _spread(self, space: Space, points: Array) -> tuple[Array, Array]:
        """Return mean (..., k) and deviations (..., k, 2n + 1) of points (2n + 1, ..., k)."""
        mean = space.mean(points, self.filter.mean_weights)
        return mean, coordinates_last(space.subtract(points, mean))

    def predict(self, belief: Gaussian, u: Array, dt: float) -> Gaussian:
        """Move every point by the model; P = sum of W d d' + Q."""
        x, P = belief
        model, count = self.filter.model, parts(self.filter.model, dt)
        points, h, Q = self._points(x, self._offsets(P)), dt / count, np.zeros(())
        for k in range(count):
            if k:
                step = self.dynamics.linearized_step(points[0], u, h)
                Q = sandwich(step.F, Q, step.Q)
            else:
                Q = self.dynamics.noise_covariance(points[0], u, h)
            points = self.dynamics.step(points, u, h)
        mean, d = self._spread(model.state, points)
        W = self.filter.covariance_weights
        return unchecked((mean, symmetric(product_transposed(W * d, d) + Q)))

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> BatchCorrection:
        """Fuse a reading: K = P_xy S^-1, P = sum of W (dx - K dy) (dx - K dy)' + K R K'."""
        (x, P), R = belief, sensor.covariance
        dx, W = self._offsets(P), self.filter.covariance_weights
        predicted, dy = self._spread(sensor.output, sensor.measure(self._points(x, dx)))
        innovation = sensor.output.subtract(y, predicted)
        S = symmetric(product_transposed(W * dy, dy) + R)
        K = divided(product_transposed(W * dy, dx), factor(S))
        left = dx - product(K, dy)
        P = symmetric(product_transposed(W * left, left) + sandwich(K, R, np.zeros(())))
        moved = self.filter.model.state.arrived(x + times(K, innovation), x, P)
        return BatchCorrection(unchecked(moved), innovation, S)


def batched(filter: Filter) -> BatchFilter:
    """Return the filter for beliefs with leading axes.

    Raises
    ------
    ValueError
        If there is none for this filter.
    """
    if isinstance(filter, (KalmanFilter, ExtendedKalmanFilter)):
        return BatchLinearUpdate(Dynamics(filter.model))
    if isinstance(filter, UnscentedKalmanFilter):
        return BatchUnscented(filter, Dynamics(filter.model))
    if isinstance(filter, FixedGainObserver):
        return BatchFixedGain(filter)
    raise ValueError(
        'filter: expected kf, ekf, ukf, steady_state or luenberger for a batch, '
        f'got {type(filter).__name__}'
    )


def batched_candidates(filters: Sequence[Filter]) -> BatchFilter:
    """Return p filters, which differ by the parameters of their models, for beliefs (..., p, n).

    Sensors that differ, by noise or otherwise, are those of `candidate_sensor`.

    Raises
    ------
    ValueError
        If they are not all of one kind, or of a kind with fixed gains.
    """
    kinds = {type(each) for each in filters}
    first = filters[0]
    if len(kinds) == 1 and isinstance(first, (KalmanFilter, ExtendedKalmanFilter)):
        return BatchLinearUpdate(candidate_dynamics([each.model for each in filters]))  # type: ignore[attr-defined]
    if len(kinds) == 1 and isinstance(first, UnscentedKalmanFilter):
        return BatchUnscented(first, candidate_dynamics([each.model for each in filters]))  # type: ignore[attr-defined]
    raise ValueError(
        'filter: expected several of one kind, kf, ekf or ukf, as candidates, '
        f'got {", ".join(sorted(kind.__name__ for kind in kinds))}'
    )
