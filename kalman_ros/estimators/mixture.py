# SPDX-License-Identifier: Apache-2.0
"""Weighted sums of Gaussians: moments, reduction and forecasts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from kalman_ros.core import Array, Gaussian, Space, symmetric

#: Two parts are merged if that changes the mixture by less than this relative entropy, in nats.
_ALIKE = 1e-3
#: An angle or a rotation is divided if its standard deviation is larger than the first, in rad.
#: The parts extend to N standard deviations; theirs are this share of the distance between parts.
_WIDEST, _REACH, _OVERLAP = 0.6, 3.0, 0.6


class Mixture(Gaussian):
    """A weighted sum of Gaussians that other code uses as the Gaussian of the same two moments.

    Parameters
    ----------
    weights
        Weights of the parts (k,), with the sum 1.
    parts
        Gaussians.
    space
        Space of the state.
    """

    weights: Array
    parts: Sequence[Gaussian]
    _space: Space

    def __new__(cls, weights: Array, parts: Sequence[Gaussian], space: Space) -> Mixture:
        """Return the mixture with its moments."""
        points, P = _stacked(parts)
        self = super().__new__(cls, *pooled(space, weights, points, P))
        self.weights, self.parts, self._space = weights, parts, space
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments that recreate the mixture."""
        return Mixture, (self.weights, self.parts, self._space)

    def _replace(self, **changes: Any) -> Gaussian:  # type: ignore[override]
        """Return a single Gaussian, since the parts do not have the changed moments."""
        return Gaussian(*self)._replace(**changes)


def pooled(space: Space, weights: Array, points: Array, P: Array) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) of parts with means (k, n) and covariances ``P``."""
    mean = space.mean(points, weights)
    d = space.subtract(points, mean)
    P = space.from_afar(P, d)
    return mean, symmetric(np.tensordot(weights, P, axes=1) + (weights * d.T) @ d)


def reduced(weights: Array, parts: Sequence[Gaussian], space: Space, most: int) -> Mixture:
    """Return a mixture with the same moments, of at most ``most`` parts.

    The pair whose merger changes the mixture least, by a bound of the relative entropy, is merged
    while there are too many parts or the bound is small (A. Runnalls,
    Kullback-Leibler Approach to Gaussian Mixture Reduction, IEEE Trans. Aerospace and Electronic
    Systems 43(3), 2007).
    """
    x, P = _stacked(parts)
    w, left, volume = weights.copy(), list(range(len(parts))), np.linalg.slogdet(P)[1]
    loss = np.full((len(w), len(w)), np.inf)

    def compare(i: Any, j: Any) -> None:
        """Compute the losses of merging parts ``j`` into parts ``i``."""
        total = w[i] + w[j]
        a, b = (w[i] / total)[:, None, None], (w[j] / total)[:, None, None]
        d = space.subtract(x[j], x[i])
        merged = a * P[i] + b * P[j] + a * b * d[:, :, None] * d[:, None, :]
        with np.errstate(invalid='ignore'):
            separate = w[i] * volume[i] + w[j] * volume[j]
            bound = 0.5 * (total * np.linalg.slogdet(merged)[1] - separate)
        # parts that are certain in some direction have no volume to lose
        loss[i, j] = np.where(np.isnan(bound), np.inf, bound)

    compare(*np.triu_indices(len(w), 1))
    while len(left) > 1:
        i, j = np.unravel_index(np.argmin(loss), loss.shape)
        if len(left) <= most and loss[i, j] >= _ALIKE:
            break
        pair = np.array([i, j])
        total = w[pair].sum()
        x[i], P[i] = pooled(space, w[pair] / total, x[pair], P[pair])
        w[i], volume[i] = total, np.linalg.slogdet(P[i])[1]
        left.remove(int(j))
        loss[j, :] = loss[:, j] = np.inf
        others = np.array([k for k in left if k != i], dtype=int)
        compare(np.minimum(others, i), np.maximum(others, i))
    return Mixture(w[left], [Gaussian(x[k], P[k]) for k in left], space)


def turned_parts(belief: Gaussian, space: Space, count: int) -> tuple[Array, list[Gaussian]]:
    """Return weights (k,) and parts of a belief; ``count`` parts if a turn is too wide for one.

    The belief is divided along the widest angle, or the axis of the widest rotation, at even
    angles, into Gaussians narrow enough that a turn within them is linear; the other states follow
    by regression.
    """
    x, P = belief
    widest, axis = 0.0, np.zeros(len(x))
    for place in space.turns:
        values, vectors = np.linalg.eigh(P[place, place])
        if values[-1] > widest:
            widest, axis = float(values[-1]), np.zeros(len(x))
            axis[place] = vectors[:, -1]
    reach = min(_REACH * np.sqrt(widest), np.pi)
    narrow = (_OVERLAP * 2.0 * reach / count) ** 2
    if not widest > _WIDEST**2 or not narrow < widest:
        return np.ones(1), [belief]
    angles = reach * ((2.0 * np.arange(count) + 1.0) / count - 1.0)
    slope = P @ axis / widest
    rest = P - (widest - narrow) * np.multiply.outer(slope, slope)
    weights = np.exp(-0.5 * angles**2 / (widest - narrow))
    parts = [Gaussian(*space.arrived(x + angle * slope, x, symmetric(rest))) for angle in angles]
    return weights / weights.sum(), parts


def forecast_nis(weights: Array, innovations: Array, S: Array) -> float:
    """Return a NIS that is chi-square with k degrees of freedom if the forecast is a mixture.

    For one Gaussian it is innovation' S^-1 innovation. Otherwise each coordinate is replaced by
    the standard normal quantile of its probability, given the coordinates before it
    (M. Rosenblatt, Remarks on a Multivariate Transformation, Annals of Mathematical Statistics
    23(3), 1952; F. Diebold, T. Gunther and A. Tay, Evaluating Density Forecasts, International
    Economic Review 39(4), 1998). The ratio to the variance has the right mean, too, but a rare
    reading far from the mean would outweigh all others.

    Parameters
    ----------
    weights, S
        Weights of the parts of the forecast (p,), with the sum 1, and covariances (p, k, k).
    innovations
        Reading minus the mean of each part (p, k).
    """
    from scipy.special import log_ndtr, ndtri_exp  # 0.1 s to import

    L = np.linalg.cholesky(S)
    z = np.linalg.solve(L, innovations[..., np.newaxis])[..., 0]
    with np.errstate(divide='ignore'):
        log = np.log(weights)
    nis = 0.0
    for j in range(z.shape[1]):
        below, above = (np.logaddexp.reduce(log + log_ndtr(s * z[:, j])) for s in (1.0, -1.0))
        nis += float(ndtri_exp(min(below, above))) ** 2
        log = log - 0.5 * z[:, j] ** 2 - np.log(L[:, j, j])
        log -= np.logaddexp.reduce(log)
    return nis


def _stacked(parts: Sequence[Gaussian]) -> tuple[Array, Array]:
    """Return the means (k, n) and the covariances (k, n, n) of parts."""
    return np.array([part.mean for part in parts]), np.array([part.covariance for part in parts])
