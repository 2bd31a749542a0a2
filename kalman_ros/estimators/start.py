# SPDX-License-Identifier: Apache-2.0
"""The initial belief from the first reading."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor

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
