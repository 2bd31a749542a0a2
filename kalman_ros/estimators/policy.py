# SPDX-License-Identifier: Apache-2.0
"""What an estimator in time is told about the world that its readings come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """How an `OnlineEstimator` treats what is late, doubtful or missing.

    Parameters
    ----------
    window
        Seconds for which late items are taken in; 0 takes only what comes in order.
    gates
        For some sensors, the largest normalised innovation squared that is fused.
    recover_after
        The number of rejected readings in a row, of all sensors that see the same states and
        without one that agrees, after which the covariance is widened until the next reading
        passes: a filter that is wrong and sure of it finds back (`agreement`). 0 never does.
    restart_after
        N readings in a row that are older than the window mean that the clock went back, if none
        has been up to date for 0.25 s: the estimator restarts. 0 never does.
    max_gap
        Seconds without anything after which the old belief is worth nothing: the estimator
        restarts. 0 never does.
    future_tolerance
        Seconds by which a stamp may be ahead of the time at which it comes.
    from_reading
        Start from the first reading, taken at its word (`start`), instead of from the initial
        belief alone; what that reading does not see keeps the initial belief.
    rest_until_input
        The state stays as it is until the first input, which sets it in motion: readings correct
        the belief until then, and time does not change it.
    """

    window: float = 1.0
    gates: Mapping[str, float] | None = None
    recover_after: int = 20
    restart_after: int = 10
    max_gap: float = 60.0
    future_tolerance: float = 1.0
    from_reading: bool = False
    rest_until_input: bool = False
