# SPDX-License-Identifier: Apache-2.0
"""The innovations of several readings, for many candidates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space

from .observations import Stamps


@dataclass(frozen=True)
class Block:
    """The innovations of N readings of the same coordinates of a sensor, for p candidates.

    Parameters
    ----------
    sensor, output
        Name of the sensor, and space of the coordinates.
    time
        Stamps in nanoseconds (N,).
    innovation
        Innovations (N, p, k).
    covariance
        Innovation covariances S (N, p, k, k).
    accepted
        Whether the gates accepted each reading (N, p).
    """

    sensor: str
    output: Space
    time: Stamps
    innovation: Array
    covariance: Array
    accepted: Any

    def split(self, q: int) -> Iterator[Block]:
        """Yield the blocks of q equal groups of candidates."""
        sizes = (np.split(a, q, axis=1) for a in (self.innovation, self.covariance, self.accepted))
        for innovation, covariance, accepted in zip(*sizes):
            yield replace(self, innovation=innovation, covariance=covariance, accepted=accepted)
