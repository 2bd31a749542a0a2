# SPDX-License-Identifier: Apache-2.0
"""The record of a run, over topics or in one process."""

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
        The true state (N, n), and its estimate after the readings of the step.
    covariance
        Of the estimate (N, n, n).
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
