# SPDX-License-Identifier: Apache-2.0
"""Covariance ellipse of a Gaussian in the plane."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array

#: Number of points of an outline.
_POINTS = 73


def outline(mean: Array, covariance: Array, sigmas: float = 1.0) -> Array:
    """Return the points (N, 2) at Mahalanobis distance ``sigmas`` from ``mean`` (2,).

    With P = V diag(s^2) V', the points are mean + sigmas V diag(s) (cos t, sin t), for any
    positive semi-definite P (2, 2). The ellipse of one sigma contains 39 % of a Gaussian in the
    plane, that of two sigmas 86 %.
    """
    squares, axes = np.linalg.eigh(covariance)
    t = np.linspace(0.0, 2.0 * np.pi, _POINTS)
    circle = np.stack((np.cos(t), np.sin(t)))
    scale = sigmas * np.sqrt(np.maximum(squares, 0.0))[:, np.newaxis]
    return np.asarray(mean + (axes @ (scale * circle)).T)
