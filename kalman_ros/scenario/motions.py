# SPDX-License-Identifier: Apache-2.0
"""Motions of a scenario's model, from a path or from values in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from kalman_ros.control.limiter import Limits
from kalman_ros.control.lqr import Cost, dlqr
from kalman_ros.control.motion import Motion
from kalman_ros.control.moving_point import steady_input
from kalman_ros.control.path_timing import headings, interpolated, timed_path
from kalman_ros.control.planning import MOST_STEPS, ReferenceMotion, fit
from kalman_ros.control.time_varying import (
    cost_along,
    linearized_along,
    with_gains,
)
from kalman_ros.core import Array, DesignError, OperatingPoint, in_continuous_time, is_finite

from .body_roles import body_of
from .regulator import feedback, steered, tracking, weights_of
from .scenario import Scenario

#: A motion comes as near as this share of the tolerance, if it can.
_ACCURACY = 0.1
#: A motion may differ from what was asked for by this share of its extent.
_SHARE = 0.1
#: Gains that differ by less, relative to the largest, are the same.
_SAME = 1e-6
#: An input misses a rate by less than this, relative to its size.
_MISSED = 1e-6
#: The most points of a path.
_MOST_POINTS = 1_000_000


def along_path(
    scenario: Scenario,
    points: Array,
    speed: float,
    acceleration: float,
    yaw: Array | None = None,
    times: Array | None = None,
    rounding: float = 0.05,
) -> ReferenceMotion:
    """Return the reference of a path, from rest to rest: at most this fast, or at given times.

    Parameters
    ----------
    scenario
        Has a state with a position.
    points
        Positions (K, 3) in metres, of which the coordinates are used that the state has.
    speed, acceleration
        Largest ones, in m/s and m/s^2.
    yaw
        Headings at the points (K,) in radians, for a robot that can move sideways or backwards;
        by default the direction of the path.
    times
        Seconds (K,) at which the points are passed, in place of speed and acceleration.
    rounding
        Distance in metres by which a right angle is cut, at most.

    Raises
    ------
    ValueError
        If the state has no position, or the points are not a path.
    """
    body = body_of(scenario.model.state, scenario.state)
    axes = body.position
    if not axes:
        raise ValueError('the state of this model has no position')
    if not 2 <= len(points) <= _MOST_POINTS:
        raise ValueError(f'expected 2 to {_MOST_POINTS} points, got {len(points)}')
    used = points[:, ['xyz'.index(axis) for axis in axes]]
    if not np.isfinite(used).all():
        raise ValueError('expected finite positions')
    dt = 1.0 / scenario.rate
    if times is None:
        positions = timed_path(used, speed, acceleration, rounding, dt, MOST_STEPS)
    else:
        _check_times(times, dt)
        positions = interpolated(times, used, dt)
    hints = {}
    if 'yaw' in body.index and len(axes) > 1:
        hints[body.index['yaw']] = (
            headings(positions) if yaw is None else _headings_at(used, yaw, positions)
        )
    coordinates = tuple(body.index[axis] for axis in axes)
    first, last = (
        _resting(scenario, coordinates, positions[k], {i: h[k] for i, h in hints.items()})
        for k in (0, -1)
    )
    return ReferenceMotion(dt, coordinates, positions, hints, first, last)


def _resting(
    scenario: Scenario, coordinates: Sequence[int], values: Array, hints: Mapping[int, float]
) -> OperatingPoint:
    """Return the state at rest with these values (k,) of some coordinates, or near them."""
    state, rest = scenario.model.state, scenario.model.equilibrium.state
    wanted = rest.copy()
    wanted[list(coordinates)] = values
    difference = state.subtract(wanted, rest)[list(coordinates)]
    names = [state.names[index] for index in coordinates]
    nearest = tracking(scenario, names).nearest(difference)
    found = state.add(rest, nearest.state)
    found[list(coordinates)] = values
    for index, value in hints.items():
        found[index] = value
    return OperatingPoint(found, scenario.model.equilibrium.input + nearest.input)


def _headings_at(points: Array, yaw: Array, positions: Array) -> Array:
    """Return the headings (N + 1,) at positions in time, from those at the points of a path."""
    s = _distances(points)
    passed = _distances(positions)
    share = passed * (s[-1] / passed[-1]) if passed[-1] > 0.0 else passed
    return np.asarray(np.interp(share, s, np.unwrap(yaw)))


def _distances(points: Array) -> Array:
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def in_time(
    scenario: Scenario,
    coordinates: Sequence[int],
    times: Array,
    values: Array,
    velocities: Array | None = None,
) -> ReferenceMotion:
    """Return the reference of values in time, joined by cubic polynomials.

    Parameters
    ----------
    scenario
        The system.
    coordinates
        Indices of the coordinates of the state that are given (k,).
    times
        Seconds (K,), increasing.
    values
        Values at these times (K, k).
    velocities
        Their rates of change (K, k); by default the motion begins and ends at rest.

    Raises
    ------
    ValueError
        If the times do not increase, a number is not finite, or there are too many steps.
    """
    dt = 1.0 / scenario.rate
    if not is_finite(values) or (velocities is not None and not is_finite(velocities)):
        raise ValueError('expected finite numbers')
    _check_times(times, dt)
    state = scenario.model.state
    unwrapped = values.copy()
    for column, index in enumerate(coordinates):
        if state.names[index] in state.angles:
            unwrapped[:, column] = np.unwrap(values[:, column])
    curve = interpolated(times, unwrapped, dt, velocities)
    hints = _heading(scenario, coordinates, curve)
    first, last = (
        _resting(scenario, coordinates, curve[k], {i: h[k] for i, h in hints.items()})
        if velocities is None or not velocities[k].any()
        else None
        for k in (0, -1)
    )
    return ReferenceMotion(dt, tuple(coordinates), curve, hints, first, last)


def _heading(scenario: Scenario, coordinates: Sequence[int], curve: Array) -> dict[int, Array]:
    """Return the heading along values of x and y, by its index, where it is not given."""
    index = body_of(scenario.model.state, scenario.state).index
    places = [list(coordinates).index(index[a]) for a in 'xy' if index.get(a) in coordinates]
    if len(places) < 2 or 'yaw' not in index or index['yaw'] in coordinates:
        return {}
    return {index['yaw']: headings(curve[:, places])}


def between(scenario: Scenario, start: Array, end: Array, seconds: float) -> ReferenceMotion:
    """Return the reference of a motion from one state at rest to another, by any way.

    Parameters
    ----------
    scenario
        The system.
    start, end
        States (n,) at which it begins and ends; the input there is that of the nearest
        equilibrium.
    seconds
        Duration.

    Raises
    ------
    ValueError
        If a state is not finite, the model does not rest there, or there are too many steps.
    """
    if not (is_finite(start) and is_finite(end)):
        raise ValueError('expected finite states')
    state, dt = scenario.model.state, 1.0 / scenario.rate
    _check_times(np.array([0.0, seconds]), dt)
    steps = max(round(seconds / dt), 1)
    share = np.linspace(0.0, 1.0, steps + 1)[:, np.newaxis]
    first, last = (_at_rest(scenario, what, x) for what, x in (('start', start), ('end', end)))
    way = (1.0 - share) * state.subtract(start, end)
    guess = state.add(np.broadcast_to(end, way.shape), way)
    return ReferenceMotion(dt, (), np.zeros((steps + 1, 0)), {}, first, last, guess)


def _at_rest(scenario: Scenario, what: str, state: Array) -> OperatingPoint:
    """Return a state (n,) with the input that holds it; ValueError if none does."""
    model = in_continuous_time(scenario.model)
    u = steady_input(model, state, np.zeros(model.state.size)).input
    rate = np.abs(model.derivative(state, u))
    if (rate > _MISSED * max(1.0, np.abs(u).max())).any():
        name = model.state.names[int(np.argmax(rate))]
        raise ValueError(f'{what}: no input holds the model there: {name} changes')
    return OperatingPoint(state, u)


def _check_times(times: Array, dt: float) -> None:
    """Raise ValueError if times do not increase, or make too many steps."""
    if len(times) < 2:
        raise ValueError(f'expected two points or more, got {len(times)}')
    if not is_finite(times):
        raise ValueError('expected finite times')
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if back.size:
        first = back[0]
        raise ValueError(
            f'expected increasing times, got {times[first + 1]:.6g} s after {times[first]:.6g} s'
        )
    duration = times[-1] - times[0]
    if duration > MOST_STEPS * dt:
        raise ValueError(
            f'expected at most {MOST_STEPS} steps, {MOST_STEPS * dt:.4g} s, got {duration:.4g} s'
        )


def motion_of(
    scenario: Scenario,
    reference: ReferenceMotion,
    limits: Limits | None = None,
    tolerance: float | Sequence[float] = 0.05,
) -> Motion:
    """Return the motion of a scenario's model that follows a reference, with its gains.

    A nonlinear model with the law ``lqr`` has the gains of the time-varying regulator; otherwise
    they are those of the law.

    Parameters
    ----------
    scenario
        The model, the law and its weights.
    reference
        The wanted motion.
    limits
        Limits of the inputs; none by default.
    tolerance
        How far a coordinate may be from the reference, beyond a tenth of the reference's extent;
        one for all or one each (n,).

    Raises
    ------
    ValueError
        If no motion of the model is that near, or it needs an input beyond its limit; the message
        names which, and the time.
    DesignError
        If there is no input, or no regulator along the motion.
    """
    model = scenario.model
    if not model.input.size:
        raise DesignError('model: it has no input, so there is nothing to move')
    accuracy = _ACCURACY * float(np.min(tolerance))
    motion = fit(model, reference, weights_of(scenario), accuracy)
    _check_followed(scenario, motion, reference, tolerance)
    _check_inputs(scenario, motion, limits)
    return with_law(scenario, motion)


def with_law(scenario: Scenario, motion: Motion) -> Motion:
    """Return a motion with the gains of a scenario's law."""
    if scenario.law != 'lqr' or scenario.model.is_linear:
        return motion
    found = with_gains(scenario.model, motion, weights_of(scenario))
    assert found.gains is not None
    steady = feedback(scenario).gain
    if np.allclose(found.gains[-1], steady, rtol=_SAME, atol=_SAME * np.abs(steady).max()):
        found.gains[-1] = steady  # to the last bit what the law does at rest
    return found


def moving_point(
    scenario: Scenario,
    state: Array,
    rate: Array | None,
    seconds: float,
    rate_seconds: float = 0.0,
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
    if scenario.law != 'lqr' or model.is_linear:
        return motion
    gains = np.empty((len(states), *feedback(scenario).gain.shape))
    gains[:] = _gain_at(scenario, state, inputs[0])
    gains[-1] = feedback(scenario).gain
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


def _check_inputs(scenario: Scenario, motion: Motion, limits: Limits | None) -> None:
    """Raise ValueError if a motion needs inputs beyond their limits."""
    if limits is None:
        return
    input = scenario.model.input
    rate: Array = np.abs(np.diff(motion.inputs[:-1], axis=0)) / motion.dt
    for what, values, most in (
        ('input_limit', np.abs(motion.inputs), limits.magnitude),
        ('input_rate_limit', rate, limits.rate),
    ):
        beyond = np.where(np.isfinite(most), values - most, -inf)
        if beyond.size and (beyond > 0.0).any():
            step, index = divmod(int(np.argmax(beyond)), input.size)
            raise ValueError(
                f'it needs {input.names[index]} of {values[step, index]:.3g} at '
                f'{step * motion.dt:.3g} s, more than the {what} of {most[index]:g}'
            )
