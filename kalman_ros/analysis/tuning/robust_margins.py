# SPDX-License-Identifier: Apache-2.0
"""Margins of a fitted design, and the worst margins over plants within the intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import degrees

from kalman_ros.analysis.input_loops import even_estimator
from kalman_ros.analysis.observability import stacked
from kalman_ros.control.compensator import current_compensator
from kalman_ros.control.delay import sampled_plant
from kalman_ros.control.margins import Margins, margins
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import DesignError, Dynamics, linearize
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import feedback


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
    model, dt = scenario.model, 1.0 / scenario.rate
    law, point = feedback(scenario), scenario.model.equilibrium
    C = stacked(scenario, point.state)

    def sampled(plant: Dynamics) -> StateSpace:
        return sampled_plant(linearize(plant, *plant.equilibrium), C, dt)

    estimator = even_estimator(scenario, point)
    H = current_compensator(sampled(model), law.system(dt), estimator)
    loops = [H @ sampled(plant) for plant in plants]
    nominal, results = H @ sampled(model), []
    for index, name in enumerate(model.input.names):
        fitted = margins(nominal.channel(index))
        stable = [fitted]
        for loop in loops:
            try:
                stable.append(margins(loop.channel(index)))
            except DesignError:
                continue
        results.append(
            RobustMargins(
                name, fitted,
                min(other.upper_gain.value for other in stable),
                degrees(min(other.lag.value for other in stable)),
                min(other.delay.value for other in stable),
                len(loops) + 1 - len(stable), len(loops),
            )
        )  # fmt: skip
    return results
