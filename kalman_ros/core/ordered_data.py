# SPDX-License-Identifier: Apache-2.0
"""Inputs and readings in the order of time, and the matrices of a filter that processes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from kalman_ros.linear.matrices import Array


class OrderedData(NamedTuple):
    """Instants (S,) at which an input begins to act or a sensor is read, in their order.

    Parameters
    ----------
    time
        Times in seconds.
    dt
        Length of the step that leads to each instant; 0 if there is none.
    inputs, input
        Inputs (I, m), and the one by index that acts in the step.
    sensor, row
        Index of the sensor that is read, and that of its reading; -1 where an input begins.
    readings, covariances
        Readings (N, k) of each sensor and their noise covariances (N, k, k), in order.
    start
        Index of the instant at the belief of which the step begins (S,), -1 for the first belief;
        None if that is the one before.
    """

    time: Array
    dt: Array
    inputs: Array
    input: Any
    sensor: Any
    row: Any
    readings: Sequence[Array]
    covariances: Sequence[Array]
    start: Any = None


class ReadingMatrices(NamedTuple):
    """Corrections by the readings of one sensor.

    Parameters
    ----------
    H, K, S, innovation
        Jacobians (N, k, n), gains (N, n, k), innovation covariances (N, k, k) and innovations.
    white, log, whitened
        L^-1 (N, k, k) with S = L L', log |2 pi S| (N,) and L^-1 innovation (N, k).
    """

    H: Array
    K: Array
    S: Array
    innovation: Array
    white: Array
    log: Array
    whitened: Array


class StepMatrices(NamedTuple):
    """The steps to the readings of all sensors, and the corrections of each.

    Parameters
    ----------
    F, Q
        Transitions from one reading to the next (E, n, n), and their noise covariances.
    x, P
        Predictions (E, n) and their covariances (E, n, n).
    after
        Mean (n,) and covariance (n, n) after the last instant.
    fused
        Whether an instant is that of a reading that is fused (S,).
    readings
        Corrections by the fused readings of each sensor.
    """

    F: Array
    Q: Array
    x: Array
    P: Array
    after: tuple[Array, Array]
    fused: Any
    readings: Sequence[ReadingMatrices]


class FirstSteps(NamedTuple):
    """The first instants of ordered data, up to one that the filter leaves to its caller.

    Parameters
    ----------
    mean, covariance
        Beliefs (S, n), (S, n, n) after each of them.
    innovation, S, nis
        Innovations (N, k) by sensor, their covariances (N, k, k) and normalised squares (N,).
    """

    mean: Array
    covariance: Array
    innovation: Sequence[Array]
    S: Sequence[Array]
    nis: Sequence[Array]
