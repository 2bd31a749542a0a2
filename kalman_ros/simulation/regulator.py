# SPDX-License-Identifier: Apache-2.0
"""The regulator that a scenario asks for: what the controller runs and what theory speaks of."""

from __future__ import annotations

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.laws import build_law
from kalman_ros.control.lqr import Cost, LqrDesign, cost, sampled_cost, sampled_lqr
from kalman_ros.control.tracking import FeedForward, feed_forward
from kalman_ros.core import DesignError, LinearSystem, linearize

from .scenario import Scenario


def regulator(scenario: Scenario) -> tuple[LqrDesign, Cost]:
    """Return the sampled LQR of a scenario about its equilibrium, and the cost of one sample.

    Raises
    ------
    DesignError
        If there is no input, or no gain that stabilises the system.
    """
    if not scenario.model.input.size:
        raise DesignError('model: it has no input, so there is nothing to control')
    system, weights = _system(scenario)
    return sampled_lqr(system, weights, 1.0 / scenario.rate), price(scenario)


def feedback(scenario: Scenario) -> Feedback:
    """Return the gains of the law that a scenario asks for, about its equilibrium.

    Raises
    ------
    DesignError
        If there is no input, or the law has no solution.
    """
    if not scenario.model.input.size:
        raise DesignError('model: it has no input, so there is nothing to control')
    dt = 1.0 / scenario.rate
    return build_law(scenario.law, *_system(scenario), dt, scenario.law_options)


def tracking(scenario: Scenario) -> FeedForward:
    """Return the equilibria of references for the whole state, about that of the model."""
    return feed_forward(_system(scenario)[0])


def price(scenario: Scenario) -> Cost:
    """Return the cost of one sample of a scenario, whether or not it can be controlled."""
    return sampled_cost(*_system(scenario), 1.0 / scenario.rate)


def _system(scenario: Scenario) -> tuple[LinearSystem, Cost]:
    """Return a scenario linearised about its equilibrium, and its continuous cost."""
    model = scenario.model
    size = model.state.size, model.input.size
    weights = cost(scenario.state_cost, scenario.input_cost, size)
    return linearize(model, *model.equilibrium), weights
