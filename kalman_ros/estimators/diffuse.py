# SPDX-License-Identifier: Apache-2.0
"""Exact diffuse starts: beliefs that know nothing of some states, as infinite variances say.

Such a belief is the limit of a covariance P + c U for c to infinity. Both parts move through
predictions, U by F U F' alone, and readings take directions out of U, one number at a time. With
the row h of a number with variance r, f = h P h' + r, f_u = h U h', m = P h' and m_u = U h',

    f_u > 0:  k = m_u / f_u,   U <- U - k m_u',   P <- P - m k' - k m' + f k k',
    f_u = 0:  k = m / f,       P <- P - k m',

and x <- x + k v. A number of the first kind adds -1/2 log f_u to the log-likelihood, as for R's
KFAS and statsmodels (J. Durbin and S. J. Koopman, Time Series Analysis by State Space Methods,
second edition, 2012, sections 5.2, 6.4 and 7.2.2). Once U is zero, the belief is an ordinary one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian
from kalman_ros.linear.batched import product

#: A share of the largest entry of U, by which a smaller one is rounding.
_ROUNDING = 1e-12
#: Names of filters that start so, for errors.
_EXPECTED = 'expected kf or ekf'


class Diffuse(Gaussian):
    """A belief with infinite variances, which other code sees in its covariance.

    Parameters
    ----------
    mean
        Mean (..., n), arbitrary in the directions that are unknown.
    known, unknown
        P and U (..., n, n): the covariance is the limit of P + c U.
    """

    known: Array
    unknown: Array

    def __new__(cls, mean: Array, known: Array, unknown: Array) -> Diffuse:
        """Return the belief, with infinities for what is unknown in its covariance."""
        with np.errstate(invalid='ignore'):
            covariance = np.where(unknown == 0.0, known, np.copysign(np.inf, unknown))
        self: Diffuse = tuple.__new__(cls, (mean, covariance))
        self.known, self.unknown = known, unknown
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments that recreate the belief."""
        return Diffuse, (self.mean, self.known, self.unknown)

    def _replace(self, **changes: Any) -> Gaussian:  # type: ignore[override]
        """Return an ordinary belief with the changes."""
        return Gaussian(*self)._replace(**changes)

    @property
    def finite(self) -> Gaussian:
        """The mean with the covariance P."""
        return Gaussian(self.mean, self.known)

    def moved(self, after: Gaussian, F: Array) -> Diffuse:
        """Return the belief after a step that maps errors by F, and what is known to ``after``."""
        return Diffuse(*after, product(product(F, self.unknown), F.swapaxes(-1, -2)))

    def at(self, c: float) -> Gaussian:
        """Return the ordinary belief with the covariance P + c U."""
        return Gaussian(self.mean, self.known + c * self.unknown)


def begun(belief: Gaussian) -> Gaussian:
    """Return a first belief as a `Diffuse` one if it has infinite variances."""
    x, P = belief
    infinite = np.isinf(P.diagonal(axis1=-2, axis2=-1))
    if isinstance(belief, Diffuse) or not infinite.any():
        return belief
    either = infinite[..., :, np.newaxis] | infinite[..., np.newaxis, :]
    unknown = np.where(either, infinite[..., np.newaxis] * np.eye(x.shape[-1]), 0.0)
    return Diffuse(x, np.where(either, 0.0, P), unknown)


def known_part(belief: Gaussian) -> Gaussian:
    """Return a belief without what it knows nothing of."""
    return belief.finite if isinstance(belief, Diffuse) else belief


def check_start(filter: Any, belief: Gaussian, name: str = 'initial_std') -> None:
    """Raise ValueError if a filter cannot start from the infinite variances of a belief."""
    if not filter.diffuse and np.isinf(belief.covariance).any():
        raise ValueError(
            f'{name}: a start from infinite variances takes another filter: {_EXPECTED}, got '
            f'{type(filter).__name__}'
        )


class Update(NamedTuple):
    """A correction: the change of the mean (..., n), and P and U after it.

    ``gain`` (..., n, k) maps the innovation to the change. ``innovation`` (..., k) and
    ``covariance`` (..., k, k) have the likelihood of the reading, and no innovation where nothing
    was known.
    """

    change: Array
    known: Array
    unknown: Array
    gain: Array
    innovation: Array
    covariance: Array


def update(belief: Diffuse, innovation: Array, H: Array, R: Array) -> Update:
    """Return the correction of a belief by an innovation (..., k), H (..., k, n) and R (k, k)."""
    k, n = H.shape[-2:]
    lead = np.broadcast_shapes(innovation.shape[:-1], H.shape[:-2], R.shape[:-2])
    W = _whitening(R)
    H, r = product(W, H), product(product(W, R), W.swapaxes(-1, -2)).diagonal(axis1=-2, axis2=-1)
    P = np.broadcast_to(belief.known, (*lead, n, n))
    U = np.broadcast_to(belief.unknown, (*lead, n, n))
    least = _ROUNDING * np.abs(U).max(axis=(-2, -1))
    gain, rows = np.zeros((*lead, n, k)), np.zeros((*lead, k, k))
    D, known = np.zeros((*lead, k)), np.zeros((*lead, k), dtype=bool)
    for i in range(k):
        h = H[..., i, :]
        m, m_u = _times(P, h), _times(U, h)
        f, f_u = np.sum(h * m, axis=-1) + r[..., i], np.sum(h * m_u, axis=-1)
        known[..., i] = sure = f_u <= least * np.sum(h * h, axis=-1)
        size = np.where(sure, f, f_u)
        D[..., i] = np.where(sure, f, f_u / (2.0 * np.pi))
        gained = np.where(sure[..., np.newaxis], m, m_u) / size[..., np.newaxis]
        # v = row nu, by what the numbers before it have changed
        rows[..., i, :] = row = W[..., i, :] - _times(gain.swapaxes(-1, -2), h)
        gain = gain + _outer(gained, row)
        both = sure[..., np.newaxis, np.newaxis]
        of_known = _outer(gained, m)
        learnt = of_known + of_known.swapaxes(-1, -2) - f[..., None, None] * _outer(gained, gained)
        P = P - np.where(both, of_known, learnt)
        U = np.where(both, U, U - _outer(gained, m_u))
        U = np.where(np.abs(U) > least[..., np.newaxis, np.newaxis], U, 0.0)
    P = 0.5 * (P + P.swapaxes(-1, -2))
    v = np.where(known, _times(rows, innovation), 0.0)
    back = np.linalg.inv(rows)
    S = product(back * D[..., np.newaxis, :], back.swapaxes(-1, -2))
    return Update(_times(gain, innovation), P, U, gain, _times(back, v), S)


def _whitening(R: Array) -> Array:
    """Return W (..., k, k) such that W R W' is diagonal."""
    k = R.shape[-1]
    if not (R * (1.0 - np.eye(k))).any():
        return np.eye(k)
    return np.linalg.inv(np.linalg.cholesky(R))


def _times(A: Array, x: Array) -> Array:
    return np.asarray((A @ x[..., np.newaxis])[..., 0])


def _outer(a: Array, b: Array) -> Array:
    return np.asarray(a[..., :, np.newaxis] * b[..., np.newaxis, :])


def settled(mean: Array, known: Array, unknown: Array) -> Gaussian:
    """Return a belief, an ordinary one if nothing is unknown."""
    return Diffuse(mean, known, unknown) if unknown.any() else Gaussian(mean, known)
