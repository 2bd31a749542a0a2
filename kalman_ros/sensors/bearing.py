# SPDX-License-Identifier: Apache-2.0
"""The direction of something in the plane, and nothing of its distance: a camera, a sonar."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Gaussian, Sensor, Space, variances, vector

#: Nearer than this, in m, a direction means nothing.
_NEAREST = 1e-6
#: Hypotheses of the range reach N standard deviations to both sides of that of the belief, and
#: the farthest is at most M times as far as the nearest.
_REACH, _RATIO = 2.5, 20.0


class Bearing(Sensor):
    """theta = atan2(y - y_0, x - x_0).

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviation of the angle, in rad.
    measures
        The names of the two states that are x and y.
    position
        Where the sensor stands, x_0 and y_0; the origin for one that x and y are seen from.
    """

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[Sequence[str], About('names of the states that are x and y')] = (
            'x',
            'y',
        ),
        position: Annotated[Sequence[float], About('x and y of the sensor itself', 'm')] = (
            0.0,
            0.0,
        ),
    ) -> None:
        self._indices = state.indices(measures, 'measures')
        if len(self._indices) != 2:
            raise ValueError(f'measures: expected 2 names, got {len(self._indices)}')
        self._position = vector('position', position, 2)
        self.output = Space(('bearing',), ('rad',), angles=('bearing',))
        self.covariance = variances('noise', noise, 1)

    def line_of_sight(self, x: Array) -> Array:
        """Return the way from the sensor to what it sees (..., 2), in m."""
        return np.asarray(x[..., self._indices] - self._position)

    def measure(self, x: Array) -> Array:
        """Return the direction, from the x axis towards the y axis."""
        dx, dy = np.moveaxis(self.line_of_sight(x), -1, 0)
        return np.asarray(np.arctan2(dy, dx)[..., np.newaxis])

    def jacobian(self, x: Array) -> Array:
        """Return [-dy, dx] / r^2 in the places of x and y."""
        dx, dy = self.line_of_sight(x)
        H = np.zeros((1, x.size))
        H[0, self._indices] = np.array([-dy, dx]) / max(dx**2 + dy**2, _NEAREST**2)
        return H

    def hypotheses(self, belief: Gaussian, y: Array, count: int) -> list[tuple[float, Gaussian]]:
        """Return ``count`` ranges at which what was seen may be, in the direction of the reading.

        They follow each other by one factor, so that each is as uncertain, relative to its
        range, as the next; only so does an extended filter serve all of them alike (N. Peach,
        Bearings-only tracking using a set of range-parameterised extended Kalman filters, IEE
        Proc. Control Theory and Applications 142(1), 1995). The belief, cut along the line of
        sight, says which ranges are likely. At each the angle is fused with the belief's, and
        weighed by the density of a Gaussian in polar coordinates, linearised about the reading.
        """
        expected = self.line_of_sight(belief.mean)
        P = belief.covariance[np.ix_(self._indices, self._indices)]
        if not np.linalg.eigvalsh(P)[0] > 0.0:
            return []  # the place is known, or on a line
        precision = np.linalg.inv(P)
        along, across = _directions(float(y[0]))
        sigma = 1.0 / sqrt(along @ precision @ along)
        r = max(sigma**2 * float(along @ precision @ expected), 0.0)
        farthest = r + _REACH * sigma
        edges = np.geomspace(max(r - _REACH * sigma, farthest / _RATIO), farthest, count + 1)
        logs, parts = [], []
        for near, far in zip(edges.tolist(), edges[1:].tolist()):
            distance, width = 0.5 * (near + far), (far - near) / sqrt(12.0)
            away = expected - distance * along
            information = distance**2 * (across @ precision @ across) + 1.0 / self.covariance[0, 0]
            shift = distance * (across @ precision @ away)
            log = np.log(distance * (far - near)) - 0.5 * np.log(information)
            logs.append(log - 0.5 * (away @ precision @ away - shift**2 / information))
            a, c = _directions(float(y[0] + shift / information))
            shape = width**2 * np.outer(a, a) + distance**2 / information * np.outer(c, c)
            parts.append(self._placed(belief, distance * a, shape))
        return list(zip(np.exp(np.array(logs) - max(logs)).tolist(), parts))

    def _placed(self, belief: Gaussian, line_of_sight: Array, covariance: Array) -> Gaussian:
        """Return the belief with another place, of which nothing else in it tells."""
        x, P = belief.mean.copy(), belief.covariance.copy()
        x[self._indices] = self._position + line_of_sight
        P[self._indices, :] = P[:, self._indices] = 0.0
        P[np.ix_(self._indices, self._indices)] = covariance
        return belief._replace(mean=x, covariance=P)


def _directions(theta: float) -> tuple[Array, Array]:
    """Return the unit vectors along and across a line of sight."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c, s]), np.array([-s, c])


SENSOR = Bearing
