# SPDX-License-Identifier: Apache-2.0
"""What happened in a run, whether it went over topics or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from kalman_ros.core import Array


@dataclass(frozen=True)
class Series:
    """Vectors in time: ``time`` (N,) in seconds since the start, ``values`` (N, k).

    ``covariance`` (N, k, k) is that of each value, where the messages carry it.
    """

    time: Array
    values: Array
    covariance: Array | None = None


@dataclass(frozen=True)
class Innovations:
    """The innovations of one sensor (N, k), their expected deviations (N, k) and NIS (N,)."""

    time: Array
    values: Array
    std: Array
    nis: Array


@dataclass(frozen=True)
class Trajectory:
    """A run of a closed loop, step by step.

    Parameters
    ----------
    time
        Of each step (N,), in seconds since the start.
    truth, estimate
        The state (N, n), as it was and as it was believed to be after the readings of the step.
    covariance
        What the estimator said of its error (N, n, n).
    input
        From each step on (N, m).
    readings, innovations
        By sensor.
    """

    time: Array
    truth: Array
    estimate: Array
    covariance: Array
    input: Array
    readings: Mapping[str, Series]
    innovations: Mapping[str, Innovations]
