# SPDX-License-Identifier: Apache-2.0
"""The bearing of a target in the plane, without its distance: a camera, a sonar."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import erfc, pi, sqrt
from typing import Annotated

import numpy as np

from kalman_ros.core import (
    About,
    Array,
    Gaussian,
    Hypotheses,
    Sensor,
    Space,
    coordinates,
    symmetric,
    variances,
    vector,
)

#: Distance in m below which a bearing is undefined.
_NEAREST = 1e-6
#: A Gaussian is too wide for a bearing if its standard deviation along the line of sight is more
#: than this share of the range, since it then lacks what passes close; or if the second-order
#: term of the predicted angle is more than this share of the noise, as standard deviations.
_WIDE, _CURVED = 0.25, 0.25
#: Standard deviations up to which ranges are searched, and ratio of the nearest to the farthest.
_REACH, _NEAR = 5.0, 1e-4
#: Numbers of points of the search for ranges, and of the integral over each part of them.
_SEARCHED, _INTEGRATED = 200, 8
#: Largest ratio of the farthest to the nearest range; the nearest part reaches to the sensor.
_RATIO = 20.0
#: Number of directions at which the density of a predicted angle is computed.
_DIRECTIONS = 120


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
        The position of the sensor, x_0 and y_0; the origin if x and y are relative to it.
    """

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[Sequence[str], About('names of the states that are x and y')] = (
            'x',
            'y',
        ),
        position: Annotated[Sequence[float], About('x and y of the sensor', 'm')] = (0.0, 0.0),
    ) -> None:
        self._indices = state.indices(measures, 'measures')
        if len(self._indices) != 2:
            raise ValueError(f'measures: expected 2 names, got {len(self._indices)}')
        #: x and y of the sensor (2,), in m.
        self.position = vector('position', position, 2)
        self.output = Space(('bearing',), ('rad',), angles=('bearing',))
        self.covariance = variances('noise', noise, 1)

    def line_of_sight(self, x: Array) -> Array:
        """Return the vector from the sensor to the target (..., 2), in m."""
        return np.asarray(x[..., self._indices] - self.position)

    def measure(self, x: Array) -> Array:
        """Return the bearing, from the x axis towards the y axis."""
        dx, dy = coordinates(self.line_of_sight(x))
        return np.asarray(np.arctan2(dy, dx)[..., np.newaxis])

    def jacobian(self, x: Array) -> Array:
        """Return [-dy, dx] / r^2 in the columns of x and y."""
        dx, dy = coordinates(self.line_of_sight(x))
        H = np.zeros((1, x.shape[-1], *dx.shape))
        H[0, self._indices] = np.array([-dy, dx]) / np.maximum(dx**2 + dy**2, _NEAREST**2)
        return np.moveaxis(H, (0, 1), (-2, -1))

    def hypotheses(self, belief: Gaussian, y: Array, count: int) -> Hypotheses | None:
        """Return up to ``count`` ranges in the direction of the reading, if one is too coarse.

        One is too coarse where the second-order term of the predicted angle,
        (P_rr P_tt + P_rt^2) / r^4 along and across the line of sight, is not small against the
        noise (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
        Navigation, 2001, section 10.3.3), or where the belief reaches to the sensor itself. The
        belief times the likelihood is
        then integrated over the angle, linearised about the reading, and divided by range, so
        that each part is as uncertain, relative to its range, as the next (N. Peach,
        Bearings-only tracking using a set of range-parameterised extended Kalman filters, IEE
        Proc. Control Theory and Applications 142(1), 1995; for every reading D. Musicki, Bearings
        only single-sensor target tracking using Gaussian mixtures, Automatica 45(9), 2009).
        """
        z = self.line_of_sight(belief.mean)
        P = belief.covariance[np.ix_(self._indices, self._indices)]
        R = float(self.covariance[0, 0])
        if not _too_wide(z, P, R) or not np.linalg.eigvalsh(P)[0] > 0.0:
            return None  # or the place is known, or confined to a line
        ray = _Ray(z, P, float(y[0]), R)
        logs, places = zip(*ray.parts(count))
        regression = np.linalg.solve(P, belief.covariance[self._indices]).T
        parts = [self._conditioned(belief, z, P, regression, place) for place in places]
        shares, angles = _directions_of(z, P)
        return Hypotheses(np.array(logs), parts, shares, angles[:, np.newaxis])

    def _conditioned(
        self, belief: Gaussian, z: Array, P: Array, regression: Array, place: Gaussian
    ) -> Gaussian:
        """Return the belief if the line of sight is distributed as ``place``, not as N(z, P)."""
        total = belief.mean + regression @ (place.mean - z)
        change = regression @ (place.covariance - P) @ regression.T
        mean = self.state.reached(total, belief.mean)
        return belief._replace(mean=mean, covariance=symmetric(belief.covariance + change))


def _too_wide(z: Array, P: Array, R: float) -> bool:
    """Return whether an angle of variance ``R`` is not linear over a line of sight N(z, P)."""
    c, s = z
    radial, squared = P @ z, float(z @ z)
    P_rr, P_rt = z @ radial, c * radial[1] - s * radial[0]
    P_tt = s * s * P[0, 0] - 2.0 * c * s * P[0, 1] + c * c * P[1, 1]
    wide = P_rr > (_WIDE * squared) ** 2
    return bool(wide or P_rr * P_tt + P_rt**2 > _CURVED**2 * R * squared**4)


class _Ray:
    """The density of a place N(z, P) and of an angle that is read, over the range.

    Parameters
    ----------
    z, P
        Mean (2,) and covariance (2, 2) of the line of sight.
    y, R
        The reading and its variance.
    """

    def __init__(self, z: Array, P: Array, y: float, R: float) -> None:
        self._z, self._R = z, R
        self._precision = np.linalg.inv(P)
        self._along, self._across = _directions(y)
        self._farthest = np.hypot(*z) + _REACH * np.sqrt(np.linalg.eigvalsh(P)[1])
        self._log_scale = -0.5 * (np.linalg.slogdet(2.0 * np.pi * P)[1] + np.log(R))

    def density(self, r: Array) -> tuple[Array, Array, Array]:
        """Return log p(r, y) at ranges (N,), with mean and variance of the angle less y there."""
        precision, across = self._precision, self._across
        away = self._z - r[:, np.newaxis] * self._along
        information = r**2 * (across @ precision @ across) + 1.0 / self._R
        shift = r * (away @ precision @ across)
        least = np.einsum('ri,ij,rj->r', away, precision, away) - shift**2 / information
        log = self._log_scale + np.log(r) - 0.5 * (np.log(information) + least)
        return log, shift / information, 1.0 / information

    def parts(self, count: int) -> list[tuple[float, Gaussian]]:
        """Return the places in up to ``count`` parts of the range, and their log densities."""
        edges = self._edges(count)
        parts = []
        for near, far in pairwise(edges):
            r = near * (far / near) ** ((np.arange(_INTEGRATED) + 0.5) / _INTEGRATED)
            log, offset, variance = self.density(r)
            log += np.log(r * np.log(far / near) / _INTEGRATED)
            w = np.exp(log - log.max())
            total = w.sum()
            w /= total
            points = r[:, np.newaxis] * (self._along + np.multiply.outer(offset, self._across))
            mean = w @ points
            d = points - mean
            spread = w @ (r**2 * variance) * np.multiply.outer(self._across, self._across)
            place = Gaussian(mean, (w * d.T) @ d + spread)
            parts.append((float(log.max() + np.log(total)), place))
        return parts

    def _edges(self, count: int) -> list[float]:
        """Return the limits of the parts, over the ranges that are likely."""
        r = np.geomspace(_NEAR * self._farthest, self._farthest, _SEARCHED)
        log = self.density(r)[0] + np.log(r)
        likely = np.flatnonzero(log > log.max() - 0.5 * _REACH**2)
        near, far = r[max(likely[0] - 1, 0)], r[min(likely[-1] + 1, _SEARCHED - 1)]
        needed = np.ceil(count * np.log(far / near) / np.log(_RATIO))
        edges = np.geomspace(max(near, far / _RATIO), far, min(count, int(needed)) + 1)
        return [float(near), *edges.tolist()[1:]]


def _directions_of(z: Array, P: Array) -> tuple[Array, Array]:
    """Return shares (N,) of directions (N,) of a place N(z, P), which may lie behind, too.

    In coordinates in which P is 1 the direction phi from a mean at distance D has the density
    exp(-D^2 / 2) / (2 pi) (1 + d Phi(d) / phi(d)), with d = D cos phi: the projected normal
    distribution (K. Mardia, Statistics of Directional Data, 1972, section 3.4.7).
    """
    L = np.linalg.cholesky(P)
    mean = np.linalg.solve(L, z)
    D = float(np.hypot(*mean))
    steps = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS - 0.5
    phi = 2.0 * pi * steps * min(1.0, 6.0 / D)
    d = D * np.cos(phi)
    below = np.array([0.5 * erfc(-value / sqrt(2.0)) for value in d.tolist()])
    density = np.exp(-0.5 * D**2) + sqrt(2.0 * pi) * d * below * np.exp(0.5 * (d**2 - D**2))
    x, y = L @ _directions(phi + np.arctan2(mean[1], mean[0]))[0]
    return density / density.sum(), np.arctan2(y, x)


def _directions(theta: float | Array) -> tuple[Array, Array]:
    """Return the unit vectors along and across a line of sight."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c, s]), np.array([-s, c])


SENSOR = Bearing
