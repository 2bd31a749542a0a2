# SPDX-License-Identifier: Apache-2.0
"""A recording as a filter has seen it, as arrays: readings, inputs and beliefs."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from kalman_ros.core import Array


@dataclass(frozen=True)
class SensorRecord:
    """The N readings of one sensor, in the order in which they were received.

    Parameters
    ----------
    received, stamp
        When each was received and its stamp, when it was taken (N,), in seconds
        of one origin. A reading without a stamp has that of its receipt.
    stamped
        Whether each has a stamp (N,).
    completed
        Whether the message of each has zeros for a covariance (N,), so that it was fused with the
        configured one.
    value
        The readings (N, k).
    covariance
        The noise covariance that each was fused with (N, k, k).
    outcome
        What became of each (N,), as the name of an `Outcome`; '' where that is not known.
    innovation, innovation_covariance, nis
        Of each, (N, k), (N, k, k) and (N,); NaN where there was no correction.
    """

    received: Array
    stamp: Array
    stamped: Any
    completed: Any
    value: Array
    covariance: Array
    outcome: Any
    innovation: Array
    innovation_covariance: Array
    nis: Array

    def __len__(self) -> int:
        return len(self.received)

    def select(self, keep: Any) -> SensorRecord:
        """Return the readings that ``keep`` (N,), a mask or indices, selects."""
        return SensorRecord(*(getattr(self, each.name)[keep] for each in fields(SensorRecord)))


@dataclass(frozen=True)
class InputRecord:
    """Inputs in the order of receipt: ``received`` and ``stamp`` (N,) in s, ``value`` (N, m)."""

    received: Array
    stamp: Array
    value: Array


@dataclass(frozen=True)
class Beliefs:
    """What the filter published: ``time`` (N,) in s, ``mean`` (N, n), ``covariance`` (N, n, n)."""

    time: Array
    mean: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """The standard deviation of each state (N, n)."""
        return np.asarray(np.sqrt(self.covariance.diagonal(axis1=1, axis2=2)))
