# SPDX-License-Identifier: Apache-2.0
"""Vectors with any leading axes, taken apart and put together."""

from __future__ import annotations

import numpy as np

from kalman_ros.linear.matrices import Array


def coordinates(x: Array) -> Array:
    """Return the coordinates of vectors (..., n), each (...,), to be unpacked."""
    return x if x.ndim == 1 else np.moveaxis(x, -1, 0)


def from_coordinates(*values: Array) -> Array:
    """Return the vectors (..., n) with these coordinates, each (...,).

    Each coordinate is contiguous in memory, which is what a model computes with.
    """
    whole = np.array(values)
    return whole if whole.ndim == 1 else np.moveaxis(whole, 0, -1)
