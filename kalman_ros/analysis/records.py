# SPDX-License-Identifier: Apache-2.0
"""The readings, inputs and beliefs of a recording as arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from kalman_ros.core import Array

#: A time between readings this many times the usual one contains a loss.
_LONGER = 1.75


@dataclass(frozen=True)
class SensorRecord:
    """The N readings of one sensor, in the order in which they were received.

    Parameters
    ----------
    received, stamp
        Times at which the readings were received, and their stamps, the times at which they were
        taken (N,), in seconds from one origin. A reading without a stamp has the time at which it
        was received.
    stamped
        Whether each reading has a stamp (N,).
    completed
        Whether the covariance in the message of each reading is zero (N,), so that the reading was
        fused with the configured covariance.
    value
        Readings (N, k).
    covariance
        Noise covariance with which each reading was fused (N, k, k).
    outcome
        Name of the `Outcome` of each reading (N,); '' if it is not known.
    innovation, innovation_covariance, nis
        Innovation (N, k), its covariance (N, k, k) and the NIS (N,) of each reading; NaN without a
        correction.
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

    @property
    def unchanged(self) -> Any:
        """Which readings have the value of the one before (N,)."""
        same = (np.diff(self.value, axis=0) == 0.0).all(axis=1)
        return np.append(False, same)[: len(self)]

    def select(self, keep: Any) -> SensorRecord:
        """Return the readings that ``keep`` selects, a mask (N,) or indices."""
        return SensorRecord(*(getattr(self, field.name)[keep] for field in fields(SensorRecord)))


def period(gaps: Array) -> float:
    """Return the time from reading to reading, from times between those received (N,).

    A source that runs in steps reads at each second or third of them, so that single times tell
    less than their mean. Longer ones contain losses, and negative ones are out of order.
    """
    forward = gaps[gaps > 0.0]
    return float(np.mean(forward[forward < _LONGER * np.median(forward)]))


@dataclass(frozen=True)
class InputRecord:
    """The inputs in the order of receipt: ``received``, ``stamp`` (N,) in s, ``value`` (N, m)."""

    received: Array
    stamp: Array
    value: Array


@dataclass(frozen=True)
class Beliefs:
    """The published beliefs: ``time`` (N,) in s, ``mean`` (N, n), ``covariance`` (N, n, n)."""

    time: Array
    mean: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """Standard deviation of each state (N, n)."""
        return np.asarray(np.sqrt(self.covariance.diagonal(axis1=1, axis2=2)))
