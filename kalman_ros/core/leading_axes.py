# SPDX-License-Identifier: Apache-2.0
"""Vectors with any leading axes, taken apart and put together."""

from __future__ import annotations

import numpy as np

from kalman_ros.linear.matrices import Array
from kalman_ros.linear.views import coordinates_first, coordinates_last


def coordinates(x: Array) -> Array:
    """Return the coordinates of vectors (..., n), each (...,), to be unpacked."""
    return coordinates_first(x)


def from_coordinates(*values: Array) -> Array:
    """Return the vectors (..., n) with these coordinates, each (...,).

    Each coordinate is contiguous in memory, which is what a model computes with.
    """
    return coordinates_last(np.array(values))
