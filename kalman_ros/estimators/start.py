# SPDX-License-Identifier: Apache-2.0
"""The initial belief from the first reading, or from a body that rests."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array, Dynamics, Gaussian, Sensor, Space

#: Deviation of a rate at rest, in units of the state by s, and the seconds of noise in it.
_AT_REST, _SAMPLE = 0.1, 0.01
#: Deviation of an angle or a rotation, in rad, from which on it may be the opposite one.
_ANY = 1.0
#: Limits of the iterations, and of the halvings of a step that does not reduce the distance.
_MOST_STEPS, _MOST_HALVINGS = 50, 30
#: The iteration stops below this sum of squared residuals, in standard deviations.
_CLOSE = 1e-16


def match_reading(belief: Gaussian, y: Array, sensor: Sensor) -> Gaussian:
    """Return the belief with its mean moved to match the reading ``y`` (k,) of ``sensor`` exactly.

    This is the update of the mean without measurement noise; the reading itself is fused
    afterwards, with its noise. It is iterated as in an iterated extended filter, by the
    Gauss-Newton method (B. Bell and F. Cathey, The Iterated Kalman Filter Update as a Gauss-Newton
    Method, IEEE Trans. Automatic Control 38(2), 1993), and finds the likeliest state with that
    reading. A step that does not reduce the distance to the reading is halved until it does.
    """
    prior, P = belief.mean, belief.covariance
    weight = 1.0 / sensor.covariance.diagonal()

    def distance(x: Array) -> float:
        innovation = sensor.output.subtract(y, sensor.measure(x))
        return float(innovation @ (weight * innovation))

    x = prior
    away = distance(x)
    for _ in range(_MOST_STEPS):
        H = sensor.jacobian(x)
        # least squares, since a sensor may measure a quantity twice
        K = np.linalg.lstsq(H @ P @ H.T, H @ P, rcond=None)[0].T
        innovation = sensor.output.subtract(y, sensor.measure(x))
        correction = K @ innovation
        steps = [prior + K @ (innovation + H @ (x - prior)) - x]
        steps += [correction * 0.5**k for k in range(_MOST_HALVINGS)]
        points = (sensor.state.reached(x + step, x) for step in steps)
        nearer = next((point for point in points if distance(point) < away), None)
        if nearer is None:
            break
        x, away = nearer, distance(nearer)
        if sensor.linear or away < _CLOSE:
            break
    return belief._replace(mean=x)


class Rest(Sensor):
    """A reading of the rate of change of the state under an input, which is zero at rest."""

    def __init__(self, model: Dynamics, x: Array, u: Array) -> None:
        self._model, self._u = model, u
        self.output, self.state, self.linear = (
            Space(model.state.names),
            model.state,
            model.is_linear,
        )
        noise = np.diagonal(model.noise_density(x)) / _SAMPLE
        self.covariance = np.diag(_AT_REST**2 + noise)

    def measure(self, x: Array) -> Array:
        """Return dx/dt (..., n)."""
        u = np.broadcast_to(self._u, (*x.shape[:-1], *self._u.shape))
        return self._model.time_derivative(x, u)


def rested(belief: Gaussian, u: Array, model: Dynamics) -> Gaussian:
    """Return the belief of a state that does not change under its first input ``u`` (m,).

    With an accelerometer as the input it has the tilt.
    """
    return likeliest(belief, np.zeros(model.state.size), Rest(model, belief.mean, u), model)


def likeliest(belief: Gaussian, y: Array, sensor: Sensor, model: Dynamics) -> Gaussian:
    """Return the belief given a reading ``y`` (k,), by an iterated filter.

    What is turned by any angle may be turned the other way, from where the iteration does not
    arrive: it begins there, too.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance cannot be inverted.
    """
    # plant and controller load this module, and need no filter
    from .filters.iterated_ekf import IteratedExtendedKalmanFilter

    solver, space = IteratedExtendedKalmanFilter(model), model.state
    weight = np.linalg.pinv(belief.covariance)

    def misfit(candidate: Gaussian) -> float:
        v = sensor.output.subtract(y, sensor.measure(candidate.mean))
        d = space.subtract(candidate.mean, belief.mean)
        distance = float(v @ np.linalg.solve(sensor.covariance, v) + d @ weight @ d)
        return distance if np.isfinite(distance) else np.inf

    candidates = [
        solver.correct(belief._replace(mean=mean), y, sensor).posterior
        for mean in (belief.mean, *_turned(belief, space))
    ]
    return min(candidates, key=misfit)


def _turned(belief: Gaussian, space: Space) -> Iterator[Array]:
    """Yield the means (n,) with an unknown angle or rotation turned by half a turn."""
    for place in space.turns:
        values, axes = np.linalg.eigh(belief.covariance[place, place])
        for axis in axes.T[values > _ANY**2]:
            d = np.zeros(space.size)
            d[place] = np.pi * axis
            yield space.add(belief.mean, d)
