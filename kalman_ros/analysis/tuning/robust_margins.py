# SPDX-License-Identifier: Apache-2.0
"""Margins of a fitted design, and the worst margins over plants within the intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from kalman_ros.analysis.input_loops import margins_or_none
from kalman_ros.analysis.worst_case import Plant, PlantLoops
from kalman_ros.control.margins import Margins, margins
from kalman_ros.core import Dynamics
from kalman_ros.scenario import Scenario


@dataclass(frozen=True)
class RobustMargins:
    """The margins at one input, with all other inputs closed as designed.

    Parameters
    ----------
    input
        Name of the input.
    fitted
        Margins of the fitted model.
    upper_gain, lag, delay
        Least upper gain, phase lag in degrees and delay in seconds over all plants.
    unstable
        Number of plants that the loop does not stabilise.
    count
        Number of plants.
    """

    input: str
    fitted: Margins
    upper_gain: float
    lag: float
    delay: float
    unstable: int
    count: int


def robust_margins(scenario: Scenario, plants: Iterable[Dynamics]) -> list[RobustMargins]:
    """Return the margins of a scenario's law and estimator on its model and on ``plants``.

    The law and the steady-state filter are designed for the model of the scenario and do
    not change. As in a design, each sensor counts as if it read at every step.

    Raises
    ------
    DesignError
        If the model has no design.
    """
    models = [scenario.model, *plants]
    loops = PlantLoops(scenario, lambda at: Plant(replace(scenario, model=models[int(at[0])])))
    results = []
    for index, name in enumerate(scenario.model.input.names):
        fitted = margins(loops.broken(np.zeros(1), index))
        others = [
            margins_or_none(loops.broken(np.array([float(k)]), index))
            for k in range(1, len(models))
        ]
        stable = [fitted, *filter(None, others)]
        results.append(
            RobustMargins(
                name, fitted,
                min(other.upper_gain.value for other in stable),
                degrees(min(other.lag.value for other in stable)),
                min(other.delay.value for other in stable),
                len(models) - len(stable), len(others),
            )
        )  # fmt: skip
    return results
