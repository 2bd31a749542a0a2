# SPDX-License-Identifier: Apache-2.0
"""Exact diffuse starts: beliefs that know nothing of some states, as infinite variances say.

Such a belief is the limit of a covariance P + c U for c to infinity. Both parts move through
predictions, U by F U F' alone, and readings take directions out of U, one number at a time. With
the row h of a number with variance r, f = h P h' + r and f_u = h U h',

    k = U h' / f_u  if f_u > 0,  else  k = P h' / f,       T = I - k h,
    x <- x + k v,   P <- T P T' + r k k',   U <- T U T'.

A number of the first kind adds -1/2 log f_u to the log-likelihood, as for R's
KFAS and statsmodels (J. Durbin and S. J. Koopman, Time Series Analysis by State Space Methods,
second edition, 2012, sections 5.2, 6.4 and 7.2.2). Once U is zero, the belief is an ordinary one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor
from kalman_ros.linear.batched import product, sandwich, symmetric, times

#: A share of the largest variance in U, below which one is rounding of a correction, or of a step.
_ROUNDING, _ROUNDING_OF_STEPS = 1e-14, 1e-15
#: How far unknown states are moved to see whether a Jacobian depends on them, in their unit, the
#: seconds of a step for that, and a share of the largest entry that is rounding.
_MOVED, _STEP, _SAME = 0.7, 0.1, 1e-6
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
        unknown = _without_rounding(unknown, _ROUNDING_OF_STEPS * _largest(unknown))
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
        return Diffuse(*after, sandwich(F, self.unknown, np.zeros_like(self.unknown)))

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


def check_start(
    filter: Any, belief: Gaussian, sensors: Mapping[str, Sensor], name: str = 'initial_std'
) -> None:
    """Raise ValueError if a filter cannot start from the infinite variances of a belief.

    A model or a sensor that is not linear in a state is linearised about it, so that it has to be
    known.
    """
    unknown = np.isinf(belief.covariance.diagonal())
    if not unknown.any():
        return
    if not filter.diffuse:
        raise ValueError(
            f'{name}: a start from infinite variances takes another filter: {_EXPECTED}, got '
            f'{type(filter).__name__}'
        )
    if filter.needs_linear:
        return
    model, here = filter.model, belief.mean
    there = here + np.where(unknown, _MOVED * (1.0 + np.arange(here.size) / here.size), 0.0)
    u = model.equilibrium.input
    dt = model.period if model.is_discrete else _STEP

    def slopes(x: Array) -> dict[str, Array]:
        jacobians = {name: sensor.jacobian(x) for name, sensor in sensors.items()}
        return {**jacobians, 'the model': model.linearized_step(x, u, dt)[1]}

    after = slopes(there)
    for what, before in slopes(here).items():
        changed = np.abs(after[what] - before).max(initial=0.0)
        if changed > _SAME * np.abs((before, after[what])).max(initial=0.0):
            listed = ', '.join(
                n for n, is_unknown in zip(model.state.names, unknown) if is_unknown
            )
            raise ValueError(
                f'{name}: expected finite numbers for what {what} is not linear in, got infinite '
                f'ones for {listed}'
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
    H, r = product(W, H), sandwich(W, R, np.zeros_like(R)).diagonal(axis1=-2, axis2=-1)
    P = np.broadcast_to(belief.known, (*lead, n, n))
    U = np.broadcast_to(belief.unknown, (*lead, n, n))
    least = _ROUNDING * _largest(U)
    gain, rows = np.zeros((*lead, n, k)), np.zeros((*lead, k, k))
    D, known, none = np.zeros((*lead, k)), np.zeros((*lead, k), dtype=bool), np.zeros((n, n))
    for i in range(k):
        h = H[..., i, :]
        m, m_u = times(P, h), times(U, h)
        f, f_u = np.sum(h * m, axis=-1) + r[..., i], np.sum(h * m_u, axis=-1)
        known[..., i] = sure = f_u <= least * np.sum(h * h, axis=-1)
        size = np.where(sure, f, f_u)
        D[..., i] = np.where(sure, f, f_u / (2.0 * np.pi))
        gained = np.where(sure[..., np.newaxis], m, m_u) / size[..., np.newaxis]
        # v = row nu, by what the numbers before it have changed
        rows[..., i, :] = row = W[..., i, :] - times(gain.swapaxes(-1, -2), h)
        gain = gain + _outer(gained, row)
        T = np.eye(n) - _outer(gained, h)
        noise = r[..., i, np.newaxis, np.newaxis] * _outer(gained, gained)
        P = symmetric(sandwich(T, P, noise))
        U = _without_rounding(symmetric(sandwich(T, U, none)), least)
    v = np.where(known, times(rows, innovation), 0.0)
    back = np.linalg.inv(rows)
    S = product(back * D[..., np.newaxis, :], back.swapaxes(-1, -2))
    return Update(times(gain, innovation), P, U, gain, times(back, v), S)


def _whitening(R: Array) -> Array:
    """Return W (..., k, k) such that W R W' is diagonal."""
    k = R.shape[-1]
    if not (R * (1.0 - np.eye(k))).any():
        return np.eye(k)
    return np.linalg.inv(np.linalg.cholesky(R))


def _largest(U: Array) -> Array:
    """Return the largest variance in U (...,)."""
    return np.asarray(U.diagonal(axis1=-2, axis2=-1).max(axis=-1))


def _without_rounding(U: Array, least: Array) -> Array:
    """Return U without states whose variance in it is not above the ``least`` one (...,)."""
    none = U.diagonal(axis1=-2, axis2=-1) <= least[..., np.newaxis]
    return np.asarray(np.where(none[..., :, np.newaxis] | none[..., np.newaxis, :], 0.0, U))


def _outer(a: Array, b: Array) -> Array:
    return np.asarray(a[..., :, np.newaxis] * b[..., np.newaxis, :])


def settled(mean: Array, known: Array, unknown: Array) -> Gaussian:
    """Return a belief, an ordinary one if nothing is unknown."""
    return Diffuse(mean, known, unknown) if unknown.any() else Gaussian(mean, known)
