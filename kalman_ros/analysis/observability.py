# SPDX-License-Identifier: Apache-2.0
"""Observability of the state of a scenario."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, DesignError, OperatingPoint, linearize
from kalman_ros.linear import structure
from kalman_ros.linear.structure import Observability, continuous_poles, describe
from kalman_ros.scenario import Scenario


def observability(scenario: Scenario, point: OperatingPoint | None = None) -> Observability:
    """Return the observability, with model and sensors linearised about a point.

    The default point is the initial belief with the input of the equilibrium.

    Raises
    ------
    DesignError
        If no sensor observes a growing mode, which no filter can track.
    """
    model = scenario.model
    x, u = point or (scenario.initial_belief.mean, model.equilibrium.input)
    period = model.period if model.is_discrete else 0.0
    A = model.transition(x, u, period).F if period else linearize(model, x, u).A
    result = structure.observability(
        A, stacked(scenario, x), model.state.names, sampled=bool(period)
    )
    hidden_poles = np.array([mode.pole for mode in result.hidden], dtype=complex)
    rates = continuous_poles(hidden_poles, period) if period else hidden_poles
    growing = rates[rates.real > 1e-9]
    if growing.size:
        raise DesignError(
            f'sensors: no sensor sees the growing mode at {describe(growing)} per second; {result}'
        )
    return result


def stacked(scenario: Scenario, x: Array) -> Array:
    """Return the stacked Jacobians (k, n) of all enabled sensors at x (n,)."""
    sensors = [source.sensor for source in scenario.enabled.values()]
    return np.vstack([np.empty((0, x.size)), *(sensor.jacobian(x) for sensor in sensors)])
