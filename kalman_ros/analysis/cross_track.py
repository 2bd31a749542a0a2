# SPDX-License-Identifier: Apache-2.0
"""The distance of positions from a path."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array


def cross_track(points: Array, positions: Array) -> Array:
    """Return the distances (N,) of positions from a polygon; not a number beyond its ends."""
    side = np.diff(points, axis=0)
    moved = np.any(side != 0.0, axis=1)
    start, side = points[:-1][moved], side[moved]
    offset = positions[:, np.newaxis] - start
    share = np.sum(offset * side, axis=2) / np.sum(side * side, axis=1)
    gap = offset - np.clip(share, 0.0, 1.0)[..., np.newaxis] * side
    distance = np.linalg.norm(gap, axis=2)
    nearest = np.argmin(distance, axis=1)
    before = (nearest == 0) & (share[:, 0] <= 0.0)
    after = (nearest == len(side) - 1) & (share[:, -1] >= 1.0)
    return np.where(before | after, np.nan, distance.min(axis=1))
