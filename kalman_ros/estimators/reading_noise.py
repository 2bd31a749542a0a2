# SPDX-License-Identifier: Apache-2.0
"""The noise with which a reading counts: more where it surprises, or as innovations show."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear.kernels import kernels

from .filter import Correction

#: The readings that an adapted noise follows, and the most by which its variance departs.
MEMORY, MOST = 20, 100.0
#: The least information of a number about its noise that is counted, as a share of the most.
_LEAST_SHARE = 0.25
#: The most by which the factor falls at one reading.
_LEAST_CHANGE = 0.5
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
        nis = np.einsum('...i,...i->...', z, solved)
        with np.errstate(invalid='ignore', divide='ignore'):
            step = nis * (nis / limit - 1.0) / through
        step = np.where(nis > limit, step, 0.0)
        factor = factor + step
        if not np.any(step > 1e-14 * factor):
            break
    return factor


def adapted(scale: Any, correction: Correction, R: Array, limit: float | None = None) -> Any:
    """Return the factor (...,) of a sensor's noise after a reading.

    The noise is the declared one times an unknown factor, of which the last `MEMORY` readings
    tell. The change is a step of scoring: the slope of the log-likelihood of the innovation over
    its information tr((S^-1 R)^2) / 2, averaged over the memory (L. Ljung and T. Soderstrom,
    Theory and Practice of Recursive Identification, 1983, section 3.4). Where the state is known
    well, the factor so becomes the mean of NIS / k; where it is not, S depends little on R, and
    a step is longer, but not by more than `_LEAST_SHARE` allows.

    Parameters
    ----------
    scale
        Factor before the reading.
    correction
        By the reading, with the factor before it.
    R
        Covariance (..., k, k) of the noise with that factor.
    limit
        NIS at which a reading that lies farther away counts.
    """
    z, S = correction.innovation, correction.innovation_covariance
    _, through = _weighed(kernels(z), S, z, R)
    if limit is not None:
        through = through * np.minimum(1.0, limit / np.maximum(correction.nis, limit))
    share = np.linalg.solve(S, np.broadcast_to(R, S.shape))
    expected = np.trace(share, axis1=-2, axis2=-1)
    information = np.maximum(
        np.einsum('...ij,...ji->...', share, share), _LEAST_SHARE * z.shape[-1]
    )
    change = np.maximum(1.0 + (through - expected) / (MEMORY * information), _LEAST_CHANGE)
    return np.clip(scale * change, 1.0 / MOST, MOST)


def _weighed(k: Any, S: Array, z: Array, R: Array) -> tuple[Array, Array]:
    """Return a = S^-1 z (..., k), and a' R a (...,)."""
    solved = k.divided(z[..., np.newaxis], S)[..., 0, :]
    return solved, np.einsum('...i,...ij,...j->...', solved, R, solved)
