# SPDX-License-Identifier: Apache-2.0
"""What a motion shall follow: a path, values in time, or the way between two states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil
from typing import NamedTuple

import numpy as np

from kalman_ros.control.moving_point import steady_input
from kalman_ros.control.path_timing import headings, interpolated, timed_path
from kalman_ros.control.planning import MOST_STEPS, ReferenceMotion
from kalman_ros.core import Array, OperatingPoint, in_continuous_time, is_finite

from .body_roles import body_of
from .regulator import resting, tracking
from .scenario import Scenario

#: The most points of a path.
_MOST_POINTS = 1_000_000
#: A state changes at rest by less than this, relative to the input that holds it.
_STILL = 1e-6
#: How fast a robot turns on the spot towards a path, in rad/s, and the angle that needs no turn.
_TURNING, _ALIGNED = 1.0, 0.1
#: A path that begins within this angle of the velocity is joined without a stop before it.
_AHEAD = 1.0
#: How far ahead that is looked at, in seconds.
_LOOKED = 0.5
#: A robot that moves beside a path, or is close to it, joins it in this many times its distance;
#: at rest, if it is closer than the second number (m).
_JOINED, _BESIDE = 4.0, 0.1

#: Seconds in which what moves already comes to the path or the values.
_JOINING = 1.0


class Beginning(NamedTuple):
    """A state (n,) at which a motion begins, and its rate of change (n,) there.

    ``input`` (m,) is that of before, which a motion that is joined leaves slowly; None for any.
    """

    state: Array
    rate: Array
    input: Array | None = None


def along_path(
    scenario: Scenario,
    points: Array,
    speed: float,
    acceleration: float,
    yaw: Array | None = None,
    times: Array | None = None,
    rounding: float = 0.05,
    beginning: Beginning | None = None,
    pace: float = 1.0,
) -> ReferenceMotion:
    """Return the reference of a path to rest: at most this fast, or at given times.

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
    beginning
        Where the motion begins; by default at rest at the first point, headed along the path.
        What lies behind it on the path is left out. It stops first where the path leads back.
    pace
        Share of the speed; that of the acceleration is its square, so that bends are the same.

    Raises
    ------
    ValueError
        If the state has no position, or the points are not a path.
    """
    speed, acceleration = pace * speed, pace**2 * acceleration
    body = body_of(scenario.model.state, scenario.state)
    axes = body.position
    if not axes:
        raise ValueError('the state of this model has no position')
    if not 2 <= len(points) <= _MOST_POINTS:
        raise ValueError(f'expected 2 to {_MOST_POINTS} points, got {len(points)}')
    used = points[:, ['xyz'.index(axis) for axis in axes]]
    if not np.isfinite(used).all():
        raise ValueError('expected finite positions')
    if not np.ptp(used, axis=0).any() and np.ptp(points, axis=0).any():
        raise ValueError(
            f'expected points that differ in {", ".join(axes)}, the position that this model has'
        )
    dt = 1.0 / scenario.rate
    coordinates = tuple(body.index[axis] for axis in axes)
    velocity = np.zeros(len(axes)) if beginning is None else beginning.rate[list(coordinates)]
    if times is not None:
        _check_times(times, dt)
        positions = interpolated(times, used, dt, first=velocity)
    elif beginning is None:
        positions = timed_path(used, speed, acceleration, rounding, dt, MOST_STEPS)
    else:
        at = beginning.state[list(coordinates)]
        place, off = _nearest_place(used, at, 2.0 * np.linalg.norm(used[0] - at) + rounding)
        if velocity.any() and not _leads_on(used, place, off, at, velocity, acceleration):
            braked = _braked(scenario, coordinates, beginning, acceleration)
            rest = Beginning(braked.rest, np.zeros_like(beginning.rate))
            then = along_path(
                scenario, points, speed, acceleration, yaw, times, rounding, rest
            )  # fmt: skip
            return braked.before(then, beginning, coordinates)
        first = float(np.linalg.norm(velocity))
        used, yaw = _joined(used, yaw, at, place + _ahead(off, first))
        positions = timed_path(used, speed, acceleration, rounding, dt, MOST_STEPS, first)
        if first:
            positions = _begun(positions, at, velocity, dt)
    hints = {}
    if 'yaw' in body.index and len(axes) > 1:
        heading = headings(positions) if yaw is None else _headings_at(used, yaw, positions)
        if beginning is not None and times is None and not velocity.any():
            angle = float(beginning.state[body.index['yaw']])
            heading, positions = _turned_first(heading, positions, angle, dt)
        hints[body.index['yaw']] = heading
    start, end = (
        _resting(scenario, coordinates, positions[k], {i: h[k] for i, h in hints.items()})
        for k in (0, -1)
    )
    assert start is not None and end is not None
    begun = start.state if beginning is None else beginning.state
    joining = _JOINING if velocity.any() else 0.0
    before = beginning.input if beginning is not None and joining else None
    return ReferenceMotion(
        dt, coordinates, positions, hints, begun, end, joining=joining, input=before
    )


def _leads_on(
    points: Array, place: float, off: float, at: Array, velocity: Array, acceleration: float
) -> bool:
    """Return whether a path leads on from a place on it, long enough to stop at its end."""
    s, speed = _distances(points), float(np.linalg.norm(velocity))
    place += _ahead(off, speed)
    if s[-1] - place < 0.5 * speed * speed / acceleration:
        return False
    ahead = _at_distance(points, s, place + _LOOKED * speed) - at
    return bool(ahead @ velocity >= np.cos(_AHEAD) * speed * np.linalg.norm(ahead))


class _Braked(NamedTuple):
    """Positions (N, d) from a velocity to rest in a straight line, and the state (n,) at rest."""

    positions: Array
    rest: Array

    def before(
        self, then: ReferenceMotion, beginning: Beginning, coordinates: Sequence[int]
    ) -> ReferenceMotion:
        """Return the reference of this, and then of another that begins at rest."""
        count = len(self.positions)
        hints = {
            index: np.append(np.full(count, float(beginning.state[index])), values)
            for index, values in then.hints.items()
        }
        return replace(
            then,
            values=np.vstack((self.positions, then.values)),
            hints=hints,
            start=beginning.state,
            joining=_JOINING,
            input=beginning.input,
        )


def _braked(
    scenario: Scenario, coordinates: Sequence[int], beginning: Beginning, acceleration: float
) -> _Braked:
    """Return how a motion comes to rest in a straight line."""
    dt, index = 1.0 / scenario.rate, list(coordinates)
    velocity, at = beginning.rate[index], beginning.state[index]
    duration = float(np.linalg.norm(velocity)) / acceleration
    t = np.arange(0.0, duration, dt)[:, np.newaxis]
    positions = at + velocity * (t - 0.5 * t * t / max(duration, dt))
    stop = at + 0.5 * velocity * duration
    heading = body_of(scenario.model.state, scenario.state).index.get('yaw')
    hints = {} if heading is None else {heading: float(beginning.state[heading])}
    rest = _resting(scenario, coordinates, stop, hints)
    assert rest is not None
    return _Braked(positions, rest.state)


def _begun(positions: Array, at: Array, velocity: Array, dt: float) -> Array:
    """Return positions that begin at a place with a velocity (d,), and soon are as before.

    A polynomial takes the differences away within `_JOINING`, at first without an acceleration.
    """
    count = min(round(_JOINING / dt), len(positions) - 1)
    s = (np.arange(count) / count)[:, np.newaxis]
    off = at - positions[0]
    faster = velocity - (positions[1] - positions[0]) / dt
    moved: Array = positions.copy()
    moved[:count] += off * (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
    moved[:count] += faster * count * dt * (s - s**3 * (6.0 - 8.0 * s + 3.0 * s * s))
    return moved


def _ahead(off: float, speed: float) -> float:
    """Return how far ahead a path is joined from a distance beside it."""
    if speed:
        return min(_JOINED * off, 2.0 * _JOINING * speed)
    return _JOINED * off if off <= _BESIDE else 0.0


def _joined(
    points: Array, yaw: Array | None, at: Array, place: float
) -> tuple[Array, Array | None]:
    """Return a path from a position (d,) to a place of it and on, and the headings along it."""
    s = _distances(points)
    left = s > place
    left[-1] = True
    joined = np.vstack((at, _at_distance(points, s, place), points[left]))
    if yaw is not None:
        yaw = np.unwrap(yaw)
        yaw = np.concatenate((np.full(2, np.interp(place, s, yaw)), yaw[left]))
    return joined, yaw


def _nearest_place(points: Array, at: Array, reach: float) -> tuple[float, float]:
    """Return the distance along a path of its place nearest to a position, and that from it.

    Of the path, the first ``reach`` metres count.
    """
    s = _distances(points)
    count = min(int(np.searchsorted(s, reach, 'right')) + 1, len(points))
    first, step = points[: count - 1], np.diff(points[:count], axis=0)
    squares = np.sum(step * step, axis=1)
    share = np.sum((at - first) * step, axis=1)
    share = np.clip(np.divide(share, squares, out=share * 0.0, where=squares > 0.0), 0.0, 1.0)
    places = np.minimum(s[: count - 1] + share * np.diff(s[:count]), reach)
    distance = np.linalg.norm(_at_distance(points, s, places) - at, axis=1)
    nearest = int(np.argmin(distance))
    return float(places[nearest]), float(distance[nearest])


def _at_distance(points: Array, s: Array, distance: Array | float) -> Array:
    """Return the positions (..., d) at distances along a path, whose points are at ``s``."""
    return np.stack([np.interp(distance, s, column) for column in points.T], axis=-1)


def _turned_first(
    heading: Array, positions: Array, angle: float, dt: float
) -> tuple[Array, Array]:
    """Return headings and positions of a robot that turns on the spot first, from an ``angle``."""
    turn = (heading[0] - angle + np.pi) % (2.0 * np.pi) - np.pi
    if abs(turn) < _ALIGNED:
        return heading, positions
    s = np.linspace(0.0, 1.0, ceil(1.5 * abs(turn) / (_TURNING * dt)) + 1)[:-1]
    turned = heading[0] - turn * (1.0 - s * s * (3.0 - 2.0 * s))
    waiting = np.tile(positions[0], (len(s), 1))
    return np.append(turned, heading), np.vstack((waiting, positions))


def _resting(
    scenario: Scenario, coordinates: Sequence[int], values: Array, hints: Mapping[int, float]
) -> OperatingPoint | None:
    """Return the state at rest with these values (k,) of some coordinates; None if there is none.

    A position is always one: the model rests near it.
    """
    state, rest = scenario.model.state, scenario.model.equilibrium.state
    wanted = rest.copy()
    wanted[list(coordinates)] = values
    difference = state.subtract(wanted, rest)[list(coordinates)]
    names = [state.names[index] for index in coordinates]
    nearest = tracking(scenario, names).nearest(difference)
    missed = np.abs(nearest.state[list(coordinates)] - difference)
    position = {body_of(state, scenario.state).index.get(axis) for axis in 'xyz'}
    moves = [index not in position for index in coordinates]
    if (missed[moves] > _STILL * max(1.0, float(np.abs(difference).max()))).any():
        return None
    x = state.add(rest, nearest.state)
    x[list(coordinates)] = values
    for index, value in hints.items():
        x[index] = value
    return OperatingPoint(x, scenario.model.equilibrium.input + nearest.input)


def _headings_at(points: Array, yaw: Array, positions: Array) -> Array:
    """Return the headings (N + 1,) at positions in time, from those at the points of a path."""
    s = _distances(points)
    passed = _distances(positions)
    share = passed * (s[-1] / passed[-1]) if passed[-1] > 0.0 else passed
    return np.asarray(np.interp(share, s, np.unwrap(yaw)))


def _distances(points: Array) -> Array:
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.asarray(np.append(0.0, np.cumsum(steps)))


def in_time(
    scenario: Scenario,
    coordinates: Sequence[int],
    times: Array,
    values: Array,
    velocities: Array | None = None,
    beginning: Beginning | None = None,
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
    beginning
        Where the motion begins, in place of the first values; by default at rest.

    Raises
    ------
    ValueError
        If the times do not increase, a number is not finite, or there are too many steps.
    """
    dt, given = 1.0 / scenario.rate, list(coordinates)
    if not is_finite(values) or (velocities is not None and not is_finite(velocities)):
        raise ValueError('expected finite numbers')
    _check_times(times, dt)
    state = scenario.model.state
    unwrapped = values.copy()
    for column, index in enumerate(coordinates):
        if state.names[index] in state.angles:
            unwrapped[:, column] = np.unwrap(values[:, column])
    first = None
    if beginning is not None:
        first = beginning.rate[given]
        moved = state.subtract(beginning.state, _with(beginning.state, given, values[0]))[given]
        unwrapped[0] += moved
        if velocities is not None:
            velocities = np.vstack((first, velocities[1:]))
    curve = interpolated(times, unwrapped, dt, velocities, first)
    hints = _heading(scenario, coordinates, curve)
    start, end = (
        _resting(scenario, coordinates, curve[k], {i: h[k] for i, h in hints.items()})
        if velocities is None or not velocities[k].any()
        else None
        for k in (0, -1)
    )
    if beginning is not None:
        begun: Array | None = beginning.state
    elif velocities is None:  # other coordinates are at the equilibrium
        rest = state.add(scenario.model.equilibrium.state, np.zeros(state.size))
        begun = _with(rest, given, curve[0]) if start is None else start.state
    else:
        begun = None if start is None else start.state
    if end is None:
        last = ', '.join(f'{state.names[i]} {value:.3g}' for i, value in zip(given, curve[-1]))
        raise ValueError(f'it does not end at rest: no input holds {last} there')
    free = resting(scenario, [*given, *hints])
    joining = _JOINING if beginning is not None and beginning.rate.any() else 0.0
    return ReferenceMotion(
        dt, tuple(coordinates), curve, hints, begun, end, resting=free, joining=joining,
        input=beginning.input if beginning is not None and joining else None,
    )  # fmt: skip


def _with(state: Array, coordinates: Sequence[int], values: Array) -> Array:
    """Return a state (n,) with other values (k,) of some coordinates."""
    changed: Array = state.copy()
    changed[list(coordinates)] = values
    return changed


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
    first, last = _at_rest(scenario, start, 'start'), _at_rest(scenario, end, 'end')
    way = (1.0 - share) * state.subtract(start, end)
    guess = state.add(np.broadcast_to(end, way.shape), way)
    return ReferenceMotion(dt, (), np.zeros((steps + 1, 0)), {}, first.state, last, guess)


def _at_rest(scenario: Scenario, state: Array, which: str) -> OperatingPoint:
    """Return a state (n,) with the input that holds it; ValueError if none does."""
    model = in_continuous_time(scenario.model)
    u = steady_input(model, state, np.zeros(model.state.size)).input
    rate = np.abs(model.derivative(state, u))
    if (rate > _STILL * max(1.0, np.abs(u).max())).any():
        changing = model.state.names[int(np.argmax(rate))]
        raise ValueError(f'at the {which} no input holds the model: {changing} changes')
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
