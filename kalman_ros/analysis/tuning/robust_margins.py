# SPDX-License-Identifier: Apache-2.0
"""The margins of a fitted design, and the worst where the plant is elsewhere in the intervals."""

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
    """The margins of one input, all others closed as designed.

    Parameters
    ----------
    input
        Its name.
    fitted
        Of the fitted model.
    upper_gain, lag, delay
        The least upper gain, phase lag in degrees and delay in seconds of all plants.
    unstable
        How many of the plants the loop does not stabilise.
    count
        The number of plants.
    """

    input: str
    fitted: Margins
    upper_gain: float
    lag: float
    delay: float
    unstable: int
    count: int


def robust_margins(scenario: Scenario, plants: Iterable[Dynamics]) -> list[RobustMargins]:
    """Return the margins of a scenario's law and estimator on its own model and on ``plants``.

    The law and the steady-state filter are designed for the scenario's model, and stay. As in a
    design, each sensor counts as if it read at every step.

    Raises
    ------
    DesignError
        If there is no design for the model.
    """
    model, dt = scenario.model, 1.0 / scenario.rate
    law, point = feedback(scenario), scenario.model.equilibrium
    C = stacked(scenario, point.state)

    def sampled(plant: Dynamics) -> StateSpace:
        return sampled_plant(linearize(plant, *plant.equilibrium), C, dt)

    estimator = even_estimator(scenario, point)
    H = current_compensator(sampled(model), law.system(dt), estimator)
    loops = [H @ sampled(plant) for plant in plants]
    nominal, found = H @ sampled(model), []
    for index, name in enumerate(model.input.names):
        fitted = margins(nominal.channel(index))
        all_of = [fitted]
        for loop in loops:
            try:
                all_of.append(margins(loop.channel(index)))
            except DesignError:
                continue
        found.append(
            RobustMargins(
                name, fitted,
                min(each.upper_gain.value for each in all_of),
                degrees(min(each.lag.value for each in all_of)),
                min(each.delay.value for each in all_of),
                len(loops) + 1 - len(all_of), len(loops),
            )
        )  # fmt: skip
    return found
