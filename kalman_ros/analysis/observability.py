# SPDX-License-Identifier: Apache-2.0
"""The observability of a scenario's state."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, DesignError, OperatingPoint, linearize
from kalman_ros.linear import structure
from kalman_ros.linear.structure import Observability, continuous_poles, describe
from kalman_ros.scenario import Scenario


def observability(scenario: Scenario, point: OperatingPoint | None = None) -> Observability:
    """Return what the sensors observe, with model and sensors linearised about a point.

    By default the point is the initial belief and the input at rest.

    Raises
    ------
    DesignError
        If no sensor observes a growing mode: no filter can follow it.
    """
    model = scenario.model
    x, u = point or (scenario.initial_belief.mean, model.equilibrium.input)
    period = model.period if model.is_discrete else 0.0
    A = model.transition(x, u, period).F if period else linearize(model, x, u).A
    found = structure.observability(
        A, stacked(scenario, x), model.state.names, sampled=bool(period)
    )
    hidden = np.array([mode.pole for mode in found.hidden], dtype=complex)
    rates = continuous_poles(hidden, period) if period else hidden
    growing = rates[rates.real > 1e-9]
    if growing.size:
        raise DesignError(
            f'sensors: no sensor sees the growing mode at {describe(growing)} per second; {found}'
        )
    return found


def stacked(scenario: Scenario, x: Array) -> Array:
    """Return the Jacobians at x (n,) of all enabled sensors, stacked (k, n)."""
    sensors = [source.sensor for source in scenario.enabled.values()]
    return np.vstack([np.empty((0, x.size)), *(sensor.jacobian(x) for sensor in sensors)])
