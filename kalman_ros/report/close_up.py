# SPDX-License-Identifier: Apache-2.0
"""The start of a run, which pictures show in close-up."""

from __future__ import annotations

from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

#: The close-up shows this number of readings of the slowest sensor.
READINGS = 8
#: It is at least this share of the run.
_LEAST = 0.01


def close_up(scenario: Scenario, run: Trajectory) -> float:
    """Return how long the start is, in seconds."""
    slowest = min((source.timed.rate for source in scenario.enabled.values()), default=1.0)
    whole = float(run.time[-1])
    return min(max(READINGS / slowest, _LEAST * whole), whole)
