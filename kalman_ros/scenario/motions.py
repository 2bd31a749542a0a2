# SPDX-License-Identifier: Apache-2.0
"""Motions of a scenario's model that follow a reference, with the gains of its law."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.laws import OPTIMAL, STATE_LIMIT, WITHIN_LIMITS, bounds
from kalman_ros.control.limiter import Limits
from kalman_ros.control.lqr import Cost, dlqr
from kalman_ros.control.motion import Motion
from kalman_ros.control.moving_point import steady_input
from kalman_ros.control.planning import ReferenceMotion, fit
from kalman_ros.control.time_varying import cost_along, linearized_along, with_gains
from kalman_ros.core import Array, DesignError, OperatingPoint, in_continuous_time, is_finite

from .law import limits_of_states
from .regulator import SetPointGains, feedback, steered, tracking, weights_of
from .scenario import Scenario

#: A motion comes as near as this share of the tolerance, if it can.
_ACCURACY = 0.1
#: A motion may differ from what was asked for by this share of its extent.
_SHARE = 0.1
#: Gains that differ by less, relative to the largest, are the same.
_SAME = 1e-6
#: By how much an input that rests at its lower limit may be below it, relative to the largest of a
#: motion: to brake to rest takes a little reverse, which is cut off where an actuator has none.
_CUT = 0.1
#: A state may be beyond its limit by this share of its size. Otherwise the motion is slowed down
#: to this share of the limit, as long as an excess becomes this much less, to no less than this.
_SLIGHT, _WITHIN, _SLOWER, _SLOWEST = 0.02, 0.95, 0.8, 0.05
#: An input misses a rate by less than this, relative to its size.
_MISSED = 1e-6
#: By how much the search swerves from the straight way, in units of the states, where that fails.
_SWERVES = 0.0, 0.3, -0.3


def motion_of(
    scenario: Scenario,
    reference: ReferenceMotion | Callable[..., ReferenceMotion],
    limits: Limits | None = None,
    tolerance: float | Sequence[float] = 0.05,
    interrupt: Callable[[], None] = lambda: None,
) -> Motion:
    """Return the motion of a scenario's model that follows a reference, with its gains.

    A nonlinear model with the law ``lqr`` has the gains of the time-varying regulator; otherwise
    they are those of the law.

    Parameters
    ----------
    scenario
        The model, the law and its weights.
    reference
        The wanted motion; or a function that returns it at a share ``pace`` of its speed, which
        is then as large as the limits of the states permit.
    limits
        Limits of the inputs; none by default.
    tolerance
        How far a coordinate may be from the reference, beyond a tenth of the reference's extent;
        one for all or one each (n,).
    interrupt
        Called often; what it raises ends the search.

    Raises
    ------
    ValueError
        If no motion of the model is that near, or it needs an input or a state beyond its limit;
        the message names which, and the time.
    DesignError
        If there is no input, or no regulator along the motion.
    """
    model = scenario.model
    if not model.input.size:
        raise DesignError('model: it has no input, so there is nothing to move')
    pace, least = 1.0, inf
    while True:
        wanted = reference(pace=pace) if callable(reference) else reference
        motion = _found(scenario, wanted, _ACCURACY * float(np.min(tolerance)), interrupt)
        _check_followed(scenario, motion, wanted, tolerance)
        _check_inputs(scenario, motion, limits)
        excess = _excess(scenario, motion)
        if excess is None:
            return with_law(scenario, motion)
        over = 1.0 - excess.share
        slower = excess.share > 0.0 and over <= _SLOWER * least and pace >= _SLOWEST
        if not slower or not callable(reference):
            raise ValueError(excess.sentence)
        pace, least = pace * _WITHIN * excess.share, over


def _found(
    scenario: Scenario, reference: ReferenceMotion, accuracy: float, interrupt: Callable[[], None]
) -> Motion:
    """Return the motion nearest to a reference, also where the straight way is a dead end.

    A robot on wheels that shall park to its side starts to the left as well as to the right, so
    that the straight way between has no direction in which it gets better.
    """
    failure: ValueError | None = None
    for swerve in _SWERVES if reference.guess is not None else (0.0,):
        tried = reference if not swerve else _swerving(scenario, reference, swerve)
        try:
            return fit(scenario.model, tried, weights_of(scenario), accuracy, interrupt)
        except np.linalg.LinAlgError as error:
            failure = failure or ValueError(f'no motion of the model was found: {error}')
        except ValueError as error:
            failure = failure or error
    assert failure is not None
    raise failure


def _swerving(scenario: Scenario, reference: ReferenceMotion, amount: float) -> ReferenceMotion:
    """Return a reference whose search starts on a curve to one side."""
    assert reference.guess is not None
    bump = np.sin(np.linspace(0.0, np.pi, len(reference.guess)))[:, np.newaxis]
    sides = (-1.0) ** np.arange(reference.guess.shape[1])
    return replace(
        reference, guess=scenario.model.state.add(reference.guess, amount * bump * sides)
    )


def with_law(scenario: Scenario, motion: Motion) -> Motion:
    """Return a motion with the gains of a scenario's law, also about its last state."""
    if scenario.model.is_linear:
        return motion
    law = feedback(scenario)
    motion = replace(motion, rest=_at_rest(scenario, motion, law))
    if scenario.law not in OPTIMAL:
        return motion
    motion = with_gains(scenario.model, motion, weights_of(scenario))
    assert motion.gains is not None
    if scenario.law not in WITHIN_LIMITS:  # nothing is predicted
        motion = replace(motion, differences=None)
    assert motion.gains is not None
    steady = law.gain
    if np.allclose(motion.gains[-1], steady, rtol=_SAME, atol=_SAME * np.abs(steady).max()):
        motion.gains[-1] = steady  # to the last bit what the law does at rest
    return motion


def _at_rest(scenario: Scenario, motion: Motion, law: Feedback) -> Feedback | None:
    """Return the gains about the last state of a motion; None where they are those of the law."""
    end = OperatingPoint(motion.states[-1], motion.inputs[-1])
    regulator = SetPointGains(scenario, law).where_possible(end)
    return None if regulator is law else regulator


def moving_point(
    scenario: Scenario, state: Array, rate: Array | None, seconds: float, rate_seconds: float = 0.0
) -> Motion:
    """Return how a state moves on: the motion of a set point that is no equilibrium.

    Parameters
    ----------
    scenario
        The system.
    state
        The set point (n,).
    rate
        How fast it changes (n,), of which the coordinates count that the input acts on; they
        stay as they are if it is None.
    seconds
        How long it moves on; then it rests where it is.
    rate_seconds
        How long the rate lasts.

    Raises
    ------
    ValueError
        If the model is in discrete time, no input keeps the state at its rate, or the motion is
        not finite.
    DesignError
        If no gain stabilises the model there.
    """
    model, dt = in_continuous_time(scenario.model), 1.0 / scenario.rate
    steps = max(round(seconds / dt), 1)
    rates = np.zeros((steps, state.size))
    if rate is not None:
        rates[: max(round(rate_seconds / dt), 1)] = rate
    states, inputs = [state], []
    for wanted in rates:
        u, missed = steady_input(model, states[-1], wanted)
        if rate is None and np.abs(missed).max() > _MISSED * max(1.0, np.abs(u).max()):
            name = model.state.names[int(np.argmax(np.abs(missed)))]
            raise ValueError(f'no input keeps {name} of the set point as it is')
        inputs.append(u)
        states.append(model.step(states[-1], u, dt))
    if not is_finite(np.array(states)):
        raise ValueError('expected a set point whose motion is finite')
    rest = model.equilibrium
    there = tracking(scenario).nearest(model.state.subtract(states[-1], rest.state))
    states[-1] = model.state.add(rest.state, there.state)
    inputs.append(rest.input + there.input)
    motion = Motion(model.state, dt, np.array(states), np.array(inputs))
    if model.is_linear:
        return motion
    law = feedback(scenario)
    motion = replace(motion, rest=_at_rest(scenario, motion, law))
    if scenario.law not in OPTIMAL:
        return motion
    gains = np.empty((len(states), *law.gain.shape))
    gains[:] = _gain_at(scenario, state, inputs[0])
    gains[-1] = (motion.rest or law).gain
    return replace(motion, gains=gains)


def _gain_at(scenario: Scenario, state: Array, input: Array) -> Array:
    """Return the gain of the steady regulator (m, n) at a state that moves."""
    model, dt, weights = scenario.model, 1.0 / scenario.rate, weights_of(scenario)
    about = state[np.newaxis], input[np.newaxis]
    F, G = linearized_along(model, *about, dt)
    costs = cost_along(model, *about, weights, dt)
    try:
        return dlqr(F[0], G[0], Cost(costs.state[0], costs.input[0], costs.cross[0])).gain
    except DesignError:  # too slow to be steered
        if not steered(scenario):
            raise
        return feedback(scenario).gain


def _check_followed(
    scenario: Scenario,
    motion: Motion,
    reference: ReferenceMotion,
    tolerance: float | Sequence[float],
) -> None:
    state, given = scenario.model.state, list(reference.coordinates)
    wanted = motion.states.copy()
    wanted[:, given] = reference.values
    off = np.abs(state.subtract(motion.states, wanted))[:, given]
    off[reference.joined < 1.0] = 0.0
    allowed = np.broadcast_to(np.asarray(tolerance, dtype=float), (state.size,))[given].copy()
    extent = np.ptp(reference.values, axis=0)
    units = [state.units[index] for index in given]
    for column, unit in enumerate(units):
        largest = max(e for e, other in zip(extent, units) if other == unit)
        allowed[column] = max(allowed[column], _SHARE * largest)
    beyond = off - allowed
    if (beyond > 0.0).any():
        step, place = divmod(int(np.argmax(beyond)), len(given))
        name = state.names[given[place]]
        raise ValueError(
            f'no input follows it: {name} is {off[step, place]:.3g} {units[place]} away at '
            f'{step * motion.dt:.3g} s, allowed are {allowed[place]:.3g}'
        )


@dataclass(frozen=True)
class _Excess:
    """Where a motion leaves a limit of a state, and the share of it that would stay within.

    The share is 0 if there is none.
    """

    share: float
    sentence: str


def _excess(scenario: Scenario, motion: Motion) -> _Excess | None:
    """Return where a motion leaves the limits of the states most, if it does."""
    space = scenario.model.state
    pairs = limits_of_states(scenario.law_options)
    low, high = bounds(space, {n.removeprefix(f'{STATE_LIMIT}.'): v for n, v in pairs.items()})
    excess = np.maximum(motion.states - high, low - motion.states)
    relative = excess / np.maximum(np.abs(motion.states).max(axis=0), np.finfo(float).tiny)
    step, index = np.unravel_index(int(np.argmax(relative)), relative.shape)
    if not relative[step, index] > _SLIGHT:
        return None
    name, value = space.names[index], motion.states[step, index]
    limit = high[index] if value > high[index] else low[index]
    return _Excess(
        float(limit / value) if abs(value) > abs(limit) else 0.0,
        f'{name} is {value:.3g} {space.units[index]} at {step * motion.dt:.3g} s, beyond its '
        f'{STATE_LIMIT} of {limit:g}; a slower motion, or wider bends, may need less',
    )


def _check_inputs(scenario: Scenario, motion: Motion, limits: Limits | None) -> None:
    """Raise ValueError if a motion needs inputs beyond their limits."""
    if limits is None:
        return
    input, u, alike = scenario.model.input, motion.inputs, limits.are_alike
    rate: Array = np.abs(np.diff(u[:-1], axis=0)) / motion.dt
    at_limit = scenario.model.equilibrium.input <= limits.lower
    cut = np.where(at_limit, _CUT * np.abs(u).max(axis=0), 0.0)
    for name, values, limit, beyond in (
        ('input_limit', u, limits.upper, u - limits.upper),
        ('input_limit', u, limits.lower, np.where(alike, limits.lower - u, -inf)),
        ('input_lower_limit', u, limits.lower, np.where(alike, -inf, limits.lower - cut - u)),
        ('input_rate_limit', rate, limits.rate, rate - limits.rate),
    ):
        if beyond.size and (beyond > 0.0).any():
            step, index = divmod(int(np.argmax(beyond)), input.size)
            brakes = name == 'input_lower_limit' and at_limit[index]
            slower = 'a slower motion, or wider bends, need'
            remedy = 'a smaller acceleration needs' if brakes else slower
            raise ValueError(
                f'it needs {input.names[index]} of {values[step, index]:.3g} at '
                f'{step * motion.dt:.3g} s, beyond the {name} of {limit[index]:g}; {remedy} less'
            )
