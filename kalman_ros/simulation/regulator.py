# SPDX-License-Identifier: Apache-2.0
"""The regulator that a scenario asks for: what the controller runs and what theory speaks of."""

from __future__ import annotations

import numpy as np

from kalman_ros.control.lqr import Cost, LqrDesign, cost, sampled_cost, sampled_lqr
from kalman_ros.core import linearize

from .scenario import Scenario


def regulator(scenario: Scenario) -> tuple[LqrDesign, Cost]:
    """Return the sampled LQR of a scenario about the origin, and the cost of one sample.

    Raises
    ------
    DesignError
        If no gain stabilises the system.
    """
    model = scenario.model
    n, m = model.state.size, model.input.size
    system = linearize(model, np.zeros(n), np.zeros(m))
    weights = cost(scenario.state_cost, scenario.input_cost, (n, m))
    dt = 1.0 / scenario.rate
    return sampled_lqr(system, weights, dt), sampled_cost(system, weights, dt)
