# SPDX-License-Identifier: Apache-2.0
"""A belief about a state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arrays import Array


class Gaussian(NamedTuple):
    """A mean (n,) and a covariance (n, n).

    ``repairs`` counts how often, on the way to this belief, a covariance lost its definiteness
    to rounding and was given it back.
    """

    mean: Array
    covariance: Array
    repairs: int = 0

    @property
    def std(self) -> Array:
        """The standard deviation of each coordinate (n,)."""
        return np.sqrt(self.covariance.diagonal())
