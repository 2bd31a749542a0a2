# SPDX-License-Identifier: Apache-2.0
"""The noise with which a reading counts: more where it surprises, or as innovations show."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear.kernels import kernels

from .consistency import chi_square_gate
from .filter import Correction

#: The readings that an adapted noise follows, and the most by which its variance departs.
MEMORY, MOST = 20, 100.0
#: The least information of a number about its noise that is counted, as a share of the most.
_LEAST_SHARE = 0.25
#: The most by which the factor falls at one reading.
_LEAST_CHANGE = 0.5
#: A reading that is farther away than all but a few is no more evidence of noise than those.
_FEW = 1e-4
#: Newton's steps to a factor; each doubles its digits.
_STEPS = 12


def softening(correction: Correction, R: Array, limit: float) -> Any:
    """Return the factor (...,) of R with which the reading lies at a ``limit`` of its NIS.

    It is 1 for a reading within the limit: a reading farther away counts the less, the farther it
    is (G. Chang, Robust Kalman filtering based on Mahalanobis distance as outlier judging
    criterion, Journal of Geodesy 88, 2014, section 3). Newton's method on the reciprocal of the
    NIS, which is concave in the factor, and linear for one number.

    Parameters
    ----------
    correction
        By the reading with noise of covariance ``R``.
    R
        Covariance (..., k, k).
    limit
        Normalised innovation squared.
    """
    z, S = correction.innovation, correction.innovation_covariance
    k = kernels(z)
    factor = np.ones_like(np.asarray(correction.nis))
    for _ in range(_STEPS):
        solved, through = _weighed(k, S + (factor - 1.0)[..., np.newaxis, np.newaxis] * R, z, R)
        nis = (z * solved).sum(axis=-1)
        with np.errstate(invalid='ignore', divide='ignore', over='ignore'):
            step = np.where(nis > limit, nis / through * (nis / limit - 1.0), 0.0)
        factor = factor + step
        if not np.any(step > 1e-14 * factor):
            break
    return factor


class Adaptation(NamedTuple):
    """How the noise of a sensor follows its innovations.

    Parameters
    ----------
    limit
        NIS at which a reading that lies farther away counts.
    share
        Expected NIS of a reading that counts so and passes its gate, over its expectation k.
    """

    limit: float
    share: float

    def after(self, scale: Any, correction: Correction, R: Array) -> Any:
        """Return the factor (...,) of the noise after a reading that was fused.

        The noise is the declared one times an unknown factor, of which the last `MEMORY` readings
        tell. The change is a step of scoring: the slope of the log-likelihood of the innovation
        over its information tr((S^-1 R)^2) / 2, averaged over the memory (L. Ljung and T.
        Soderstrom, Theory and Practice of Recursive Identification, 1983, section 3.4). Where the
        state is known well, the factor so becomes the mean of NIS / k; where it is not, S depends
        little on R, and a step is longer, but not by more than `_LEAST_SHARE` allows.

        The direction of L^-1 innovation, with L L' = S, is uniform whatever its length. So a limit
        of the length changes the expectation of the slope by the ``share``, which is taken out.

        Parameters
        ----------
        scale
            Factor before the reading.
        correction
            By the reading, with that factor.
        R
            Covariance (..., k, k) of the noise with that factor.
        """
        z, S = correction.innovation, correction.innovation_covariance
        k = kernels(z)
        _, through = _weighed(k, S, z, R)
        counts = np.minimum(1.0, self.limit / np.maximum(correction.nis, self.limit))
        of_noise = k.divided(np.broadcast_to(R, S.shape), S)
        expected = of_noise.trace(axis1=-2, axis2=-1)
        squares = (of_noise * of_noise.swapaxes(-1, -2)).sum(axis=(-2, -1))
        information = MEMORY * np.maximum(squares, _LEAST_SHARE * z.shape[-1])
        change = 1.0 + (through * counts / self.share - expected) / information
        return np.minimum(np.maximum(scale * np.maximum(change, _LEAST_CHANGE), 1.0 / MOST), MOST)


def adaptation(k: int, soft_gate: float, gate: float) -> Adaptation:
    """Return the adaptation to readings of ``k`` numbers, by the limits of their NIS."""
    from scipy.special import chdtr  # slow to import

    limit = min(soft_gate, gate, chi_square_gate(1.0 - _FEW, k))
    fused = float(chdtr(k, gate))
    # of a chi-square x: E[x; x < c] = k P(x' < c), with x' of two degrees of freedom more
    mean = k * float(chdtr(k + 2, limit)) + limit * (fused - float(chdtr(k, limit)))
    return Adaptation(limit, mean / (k * fused))


def _weighed(k: Any, S: Array, z: Array, R: Array) -> tuple[Array, Array]:
    """Return a = S^-1 z (..., k), and a' R a (...,)."""
    solved = k.divided(z[..., np.newaxis], S)[..., 0, :]
    return solved, (solved[..., np.newaxis, :] @ R @ solved[..., np.newaxis])[..., 0, 0]
