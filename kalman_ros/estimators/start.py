# SPDX-License-Identifier: Apache-2.0
"""A first belief from a first reading."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor

#: Iterations, and halvings of a step that does not come nearer.
_MOST_STEPS, _MOST_HALVINGS = 50, 30
#: Residuals are small enough when their sum of squares, in standard deviations, is.
_CLOSE = 1e-16


def taken_at_its_word(belief: Gaussian, y: Array, sensor: Sensor) -> Gaussian:
    """Return the belief with what ``sensor`` sees moved to where the reading ``y`` (k,) puts it.

    This is the update without measurement noise, for the mean alone: the reading itself is
    fused afterwards, with its noise. It is iterated as an iterated extended filter is, which is
    the method of Gauss and Newton (B. Bell and F. Cathey, The Iterated Kalman Filter Update as a
    Gauss-Newton Method, IEEE Trans. Automatic Control 38(2), 1993): among the states with that
    reading, the likeliest. Where this does not come nearer to the reading, the step goes on from
    where it is, and is halved until it does.
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
        # by least squares, for a sensor may see one thing twice
        K = np.linalg.lstsq(H @ P @ H.T, H @ P, rcond=None)[0].T
        innovation = sensor.output.subtract(y, sensor.measure(x))
        towards = K @ innovation
        steps = [prior + K @ (innovation + H @ (x - prior)) - x]
        steps += [towards * 0.5**k for k in range(_MOST_HALVINGS)]
        nearer = next((x + step for step in steps if distance(x + step) < away), None)
        if nearer is None:
            break
        x, away = nearer, distance(nearer)
        if sensor.linear or away < _CLOSE:
            break
    return belief._replace(mean=x)
