# SPDX-License-Identifier: Apache-2.0
"""Duration of the start of a run that pictures show in close-up."""

from __future__ import annotations

from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

#: Number of readings of the slowest sensor in a close-up, and the most of the fastest one: more
#: teeth of a saw fill a panel.
READINGS, _TEETH = 8, 50
#: Smallest share of the run in a close-up.
_LEAST = 0.01


def close_up(scenario: Scenario, run: Trajectory) -> float:
    """Return the duration of the close-up, in seconds."""
    rates = [source.timed.rate for source in scenario.enabled.values()] or [1.0]
    whole = float(run.time[-1])
    return min(max(READINGS / min(rates), _LEAST * whole), _TEETH / max(rates), whole)
