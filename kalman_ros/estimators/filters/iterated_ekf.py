# SPDX-License-Identifier: Apache-2.0
"""The iterated extended Kalman filter: linearised where the reading leads, until it stays there.

The corrected mean is the likeliest state, given the belief and the reading, by the Gauss-Newton
method (B. Bell and F. Cathey, The Iterated Kalman Filter Update as a Gauss-Newton Method, IEEE
Trans. Automatic Control 38(2), 1993): with d the difference from the mean x of the belief, P its
covariance and H the Jacobian of the sensor at d,

    d <- K (y - h(x + d) + H d),   K = P H' (H P H' + R)^-1,

which lowers d' P^-1 d + (y - h)' R^-1 (y - h) or is halved until it does. An extended filter is
the first step. A reading that is precise beside the belief and curved over its width, as a range
or a bearing of something near, corrects by too much there, and the covariance is too small for
what is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, chosen, unchecked
from kalman_ros.estimators.diffuse import Diffuse
from kalman_ros.estimators.filter import Correction
from kalman_ros.linear.kernels import kernels

from .ekf import ExtendedKalmanFilter

#: Most steps, and most halvings of one.
_STEPS, _HALVINGS = 30, 8
#: Squared distance of a step, in standard deviations of the belief, that is the last one.
_CLOSE = 1e-12
#: A change of the cost below this is rounding.
_ROUNDING = 1e-12


class _Step(NamedTuple):
    """The sensor linearised at a difference, and the step from there."""

    gain: Array
    H: Array
    to: Array
    #: P^-1 times the difference that is reached, without the inverse.
    weight: Array


@dataclass(frozen=True)
class IteratedExtendedKalmanFilter(ExtendedKalmanFilter):
    """An extended Kalman filter that linearises a sensor about the corrected estimate."""

    linearises_once = False

    def correct(self, belief: Gaussian, y: Array, sensor: Sensor) -> Correction:
        """Return the likeliest state, and (I - K H) P (I - K H)' + K R K' with K and H there.

        Innovation, its covariance and so the NIS are those of the extended filter.
        """
        first = super().correct(belief, y, sensor)
        if sensor.linear or isinstance(belief, Diffuse):
            return first
        (x, P), k, space = belief, kernels(belief.mean), self.model.state
        R = sensor.covariance

        def residual(d: Array) -> Array:
            return sensor.output.subtract(y, sensor.measure(space.reached(x + d, x)))

        def cost(d: Array, weight: Array) -> Any:
            return (d * weight).sum(axis=-1) + k.weighed(R, residual(d))

        def step(d: Array) -> _Step:
            H = sensor.jacobian(space.reached(x + d, x))
            if space.rotations:  # by differences from x
                H = np.linalg.solve(space.slope_from_afar(d).swapaxes(-1, -2), H.swapaxes(-1, -2))
                H = H.swapaxes(-1, -2)
            H, R_y = k.ordered(H, R)
            K, S = k.gain(P, H, R_y)
            v = residual(d) + _times(H, d)
            weighted = k.divided(v[..., np.newaxis], S)[..., 0, :]
            return _Step(K, H, _times(K, v), _times(H.swapaxes(-1, -2), weighted))

        d = weight = np.zeros_like(x)
        known = cost(d, weight)
        # without a finite misfit, as of a reading without noise, the extended filter has to do;
        # each of many stops where it would alone
        active = usable = np.isfinite(known)
        if not np.any(usable):
            return first
        for _ in range(_STEPS):
            ahead, share = step(d), np.ones(known.shape)
            for _ in range(_HALVINGS):
                part = share[..., np.newaxis]
                nearer = d + part * (ahead.to - d), weight + part * (ahead.weight - weight)
                reached = cost(*nearer)
                lower = (reached < known + _ROUNDING * (1.0 + known)) & active
                if np.all(lower | ~active):
                    break
                share = np.where(lower, share, 0.5 * share)
            moved = lower[..., np.newaxis]
            change = np.where(moved, nearer[0] - d, 0.0), np.where(moved, nearer[1] - weight, 0.0)
            d, weight, known = d + change[0], weight + change[1], np.where(lower, reached, known)
            active = lower & ((change[0] * change[1]).sum(axis=-1) > _CLOSE)
            if not np.any(active):
                break
        last = step(d)
        covariance = k.joseph(last.gain, last.H, P, R)
        posterior = unchecked(space.arrived(x + d, x, covariance))
        if not np.all(usable):
            posterior = chosen(usable, posterior, first.posterior)
        innovation, S = first.innovation, first.innovation_covariance
        return Correction(posterior, innovation, S, last.gain, last.H)


def _times(A: Array, v: Array) -> Array:
    """Return A v (..., m), of A (..., m, n) and v (..., n)."""
    return np.asarray((A @ v[..., np.newaxis])[..., 0])


FILTER = IteratedExtendedKalmanFilter
