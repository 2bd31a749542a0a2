# SPDX-License-Identifier: Apache-2.0
"""The policy of the online estimator for imperfect data."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """The treatment of late, doubtful or missing data in an `OnlineEstimator`.

    Parameters
    ----------
    window
        Seconds for which late items are accepted; 0 accepts only items in order.
    gates
        Largest normalised innovation squared that is fused, by sensor.
    soft_gates
        Largest one with which a reading counts in full, by sensor; one that is farther away
        counts less (`reading_noise.softening`).
    adaptive
        Sensors whose noise follows their innovations (`reading_noise.Adaptation`).
    recover_after
        Number of consecutive readings outside their gates, soft or not, of all sensors that see
        the same states and without one that agrees, after which the covariance is widened until
        the next reading passes, so that an overconfident filter recovers (`agreement`). 0
        disables it.
    restart_after
        Number of consecutive readings older than the window after which the estimator restarts,
        if no reading was current for 0.25 s: the clock went back. 0 disables it.
    max_gap
        Seconds without data after which the belief expires and the estimator restarts. 0 disables
        it.
    future_tolerance
        Seconds by which a stamp may be ahead of its arrival.
    from_reading
        Whether to start from the first reading, taken as exact (`start`). States that the reading
        does not see keep the initial belief.
    from_rest
        Whether to start at rest: under the first input the state does not change, and the first
        reading of each sensor is fused by an iterated filter (`start`).
    rest_until_input
        Whether the state is constant until the first input, which sets it in motion. Until then
        readings correct the belief, and time does not change it.
    """

    window: float = 1.0
    gates: Mapping[str, float] | None = None
    soft_gates: Mapping[str, float] | None = None
    adaptive: Collection[str] = ()
    recover_after: int = 20
    restart_after: int = 10
    max_gap: float = 60.0
    future_tolerance: float = 1.0
    from_reading: bool = False
    from_rest: bool = False
    rest_until_input: bool = False
