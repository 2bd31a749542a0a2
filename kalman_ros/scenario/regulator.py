# SPDX-License-Identifier: Apache-2.0
"""The regulator of a scenario, shared by the controller and by theory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.laws import OPTIMAL, WITHIN_LIMITS, build_law
from kalman_ros.control.limiter import Limits, limits_of
from kalman_ros.control.lqr import Cost, LqrDesign, cost, dlqr, sampled_cost, sampled_lqr
from kalman_ros.control.moving_point import driven, steady_input
from kalman_ros.control.operating_point import is_still, unrest
from kalman_ros.control.time_varying import resting_regulator
from kalman_ros.control.tracking import FeedForward, feed_forward, resting_directions
from kalman_ros.core import (
    Array,
    DesignError,
    LinearSystem,
    OperatingPoint,
    in_continuous_time,
    is_finite,
    linearize,
)
from kalman_ros.linear.structure import uncontrollable_modes, unstable

from .idle import idle_input
from .scenario import Scenario

#: An input is beyond a limit by more than this share of it; less is rounding.
BEYOND = 1e-6
#: Derivatives of a model at two points are the same if they differ by less, relatively.
_ALIKE = 1e-6
#: A coordinate that changes by this share of the largest change does not.
_ROUNDING = 1e-12
#: A mode that no input moves may not grow faster than this, in 1/s.
_GROWTH = 1e-9


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


def feedback(scenario: Scenario, about: OperatingPoint | None = None) -> Feedback:
    """Return the gains of a scenario's law, about a point at rest; by default its equilibrium.

    Raises
    ------
    DesignError
        If there is no input, or the law has no solution.
    """
    model, m = scenario.model, scenario.model.input.size
    about = about or model.equilibrium
    if not m:
        raise DesignError('model: it has no input, so there is nothing to control')
    if not is_still(model, model.equilibrium):
        raise DesignError(
            f'model: it does not rest at its equilibrium: {unrest(model, model.equilibrium)}; '
            'kr.trim(model) finds where it does'
        )
    if model.is_discrete:
        if scenario.law != 'lqr':
            raise DesignError(
                f'law: expected lqr for a model in discrete time, got {scenario.law}'
            )
        step = model.transition(*about, model.period)
        K = dlqr(step.F, step.G, price(scenario)).gain
        return Feedback(K, np.empty((m, 0)), (), np.empty(0, dtype=complex))
    dt, system, weights = 1.0 / scenario.rate, linearize(model, *about), weights_of(scenario)
    try:
        return build_law(scenario.law, system, weights, dt, scenario.law_options)
    except DesignError:
        if not steered(scenario):
            raise
    # at rest the input is that of the equilibrium, wherever the model is and whatever its heading
    step = system.sampled(dt)
    poles = np.linalg.eigvals(step.F).astype(complex)
    prediction = None
    if scenario.law in WITHIN_LIMITS:
        at_rest = partial(resting_regulator, dt=dt)
        options = scenario.law_options
        prediction = build_law(scenario.law, system, weights, dt, options, at_rest).prediction
    return Feedback(np.zeros(step.G.T.shape), np.empty((m, 0)), (), poles, prediction)


def feedback_at(scenario: Scenario, held: OperatingPoint, known: Feedback) -> Feedback:
    """Return the gains about a set point, which are the ``known`` ones where the model is alike.

    A robot whose velocity is along its own axes moves elsewhere with another heading, so that the
    gains of its equilibrium would drive it away.

    Raises
    ------
    DesignError
        If the law has no solution there.
    """
    model = scenario.model
    if model.is_linear or not is_still(model, held):
        return known
    here, there = (_slopes(scenario, point) for point in (model.equilibrium, held))
    scale = np.abs(here).max()
    if np.allclose(here, there, rtol=_ALIKE, atol=_ALIKE * scale) or steered(scenario):
        return known
    return feedback(scenario, OperatingPoint(*map(_without_rounding, model.equilibrium, held)))


class SetPointGains:
    """The gains of a law about set points, of which those of the last one are kept.

    Parameters
    ----------
    scenario
        The system.
    law
        The gains about its equilibrium.
    fixed
        Whether these are used everywhere, as if somebody has computed them.
    """

    def __init__(self, scenario: Scenario, law: Feedback, *, fixed: bool = False) -> None:
        self._scenario, self.law, self._fixed = scenario, law, fixed
        self._last: tuple[OperatingPoint, Feedback] = scenario.model.equilibrium, law

    def at(self, held: OperatingPoint) -> Feedback:
        """Return the gains about a set point; DesignError if the law has none there."""
        if self._fixed:
            return self.law
        if not all(map(np.array_equal, held, self._last[0])):
            try:
                self._last = held, feedback_at(self._scenario, held, self.law)
            except (ArithmeticError, ValueError) as error:
                raise DesignError(f'reference: the law has no gains there: {error}') from None
        return self._last[1]

    def where_possible(self, held: OperatingPoint) -> Feedback:
        """Return the gains about a point, or those of the law where it has no solution."""
        try:
            return self.at(held)
        except DesignError:
            return self.law


def _without_rounding(here: Array, there: Array) -> Array:
    """Return ``there``; coordinates that differ by rounding alone are as ``here``."""
    change = np.abs(there - here)
    return np.where(change > _ROUNDING * change.max(initial=0.0), there, here)


def _slopes(scenario: Scenario, point: OperatingPoint) -> Array:
    """Return [A, B] of a model about a point, or [F, G] in discrete time."""
    model = scenario.model
    if model.is_discrete:
        step = model.transition(*point, model.period)
        return np.hstack((step.F, step.G))
    system = linearize(model, *point)
    return np.hstack((system.A, system.B))


def steered(scenario: Scenario) -> bool:
    """Return whether a model is regulated along motions alone.

    At rest no input moves some of its states, such as the sideways position of a robot on
    wheels.
    """
    model = scenario.model
    if model.is_linear or model.is_discrete or scenario.law not in OPTIMAL or not model.input.size:
        return False
    system = _system(scenario)[0]
    fixed = unstable(uncontrollable_modes(system.A, system.B), sampled=False)
    return bool(fixed.size) and float(fixed.real.max()) <= _GROWTH


def tracking(scenario: Scenario, names: Sequence[str] | None = None) -> FeedForward:
    """Return the equilibria of references, about that of the model.

    They are references for the coordinates with these ``names``, or for the whole state.
    """
    return feed_forward(_at_rest(scenario), names)


def resting(scenario: Scenario, held: Sequence[int]) -> tuple[Array, Array] | None:
    """Return in which directions a model can rest elsewhere; see `resting_directions`."""
    return resting_directions(_at_rest(scenario), held)


def _at_rest(scenario: Scenario) -> LinearSystem:
    """Return a system with A x + B u = 0 where a scenario's model rests, about its equilibrium."""
    model = scenario.model
    if not model.is_discrete:
        return _system(scenario)[0]
    # x = F x + G u where (F - 1) x + G u = 0
    step = model.transition(*model.equilibrium, model.period)
    F_1, none = step.F - np.eye(len(step.F)), np.zeros_like(step.Q)
    return LinearSystem(F_1, step.G, none, model.state.tangent, model.input)


def target(scenario: Scenario, equilibria: FeedForward, state: Array) -> OperatingPoint:
    """Return the state (n,) to hold and the input (m,) that holds it there.

    Raises
    ------
    ValueError
        If the state is not finite, or no input holds the system there.
    """
    rest = scenario.model.equilibrium
    difference = scenario.model.state.subtract(state, rest.state)
    if not np.isfinite(difference).all():
        raise ValueError('reference: expected finite numbers')
    equilibrium = equilibria.equilibrium(difference, rest.state)
    held = OperatingPoint(rest.state + equilibrium.state, rest.input + equilibrium.input)
    if not all(map(is_finite, held)):
        raise ValueError('reference: expected numbers whose squares are finite')
    return held


def check_held(scenario: Scenario, input: Array, limits: Limits) -> None:
    """Raise ValueError if the input (m,) that would hold a reference is beyond the limits."""
    nearest = limits.within(input)
    beyond = np.abs(input - nearest) - BEYOND * np.abs(nearest)
    if (beyond > 0.0).any():
        index, space = int(np.argmax(beyond)), scenario.model.input
        raise ValueError(
            f'reference: it takes {space.names[index]} of {input[index]:.3g} to hold it, and the '
            f'limits are {limits.lower[index]:g} and {limits.upper[index]:g}'
        )


def is_moving(scenario: Scenario, state: Array, soon: Array) -> bool:
    """Return whether a reference that becomes ``soon`` (n,) in a step moves.

    It does not where it jumps from one set point at rest to another: then the coordinates that the
    input acts on do not change.
    """
    model = in_continuous_time(scenario.model)
    u = model.equilibrium.input
    rows = driven(model, state, u)
    change = model.state.subtract(soon, state)[rows]
    offset = model.state.subtract(state, model.equilibrium.state)[rows]
    return bool(change.any() or offset.any())


def moving_target(scenario: Scenario, state: Array, soon: Array) -> OperatingPoint:
    """Return a state (n,) to hold for a step, and the input (m,) with which it becomes ``soon``.

    Raises
    ------
    ValueError
        If a state is not finite.
    """
    model = in_continuous_time(scenario.model)
    rate = model.state.subtract(soon, state) * scenario.rate
    if not is_finite(rate):
        raise ValueError('reference: expected finite numbers')
    return OperatingPoint(state, steady_input(model, state, rate).input)


def actuators(scenario: Scenario, values: Mapping[str, Any]) -> tuple[Limits, Array]:
    """Return the limits of the actuators, and their idle input (m,), by the controller's values.

    Raises
    ------
    ValueError
        As from `limits_of`, or if the idle input, or that which holds the system at rest, is
        beyond them.
    """
    model = scenario.model
    limits, idle = (
        limits_of(model.input.size, values),
        idle_input(model, values.get('idle_input', 'zero')),
    )
    limits.check('the input at rest', model.equilibrium.input)
    limits.check('the idle input', idle, '; or choose idle_input: equilibrium')
    return limits, idle


def price(scenario: Scenario) -> Cost:
    """Return the cost of one sample of a scenario, controllable or not.

    That of a model in discrete time is given for each of its periods.
    """
    if scenario.model.is_discrete:
        return weights_of(scenario)
    return sampled_cost(*_system(scenario), 1.0 / scenario.rate)


def _system(scenario: Scenario) -> tuple[LinearSystem, Cost]:
    """Return a scenario linearised about its equilibrium, and its continuous cost."""
    model = scenario.model
    return linearize(model, *model.equilibrium), weights_of(scenario)


def weights_of(scenario: Scenario) -> Cost:
    """Return the cost of a scenario as it is given: continuous, or that of a period."""
    size = scenario.model.state.size, scenario.model.input.size
    return cost(scenario.state_cost, scenario.input_cost, size)
