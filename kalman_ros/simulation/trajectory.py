# SPDX-License-Identifier: Apache-2.0
"""The record of a run, over topics or in one process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from kalman_ros.core import Array


@dataclass(frozen=True)
class Series:
    """Vectors in time: ``time`` (N,) in seconds since the start, ``values`` (N, k).

    ``covariance`` (N, k, k) is the covariance of each value, where the messages have one.
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
        Time of each step (N,), in seconds since the start.
    truth, estimate
        True state (N, n), and its estimate after the readings of the step.
    covariance
        Covariance of the estimate (N, n, n).
    input
        Input from each step on (N, m).
    readings, innovations
        Readings and innovations, by sensor.
    """

    time: Array
    truth: Array
    estimate: Array
    covariance: Array
    input: Array
    readings: Mapping[str, Series]
    innovations: Mapping[str, Innovations]
