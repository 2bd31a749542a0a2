# SPDX-License-Identifier: Apache-2.0
"""Motions of a scenario, from a path or from values in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.control.motion import Motion
from kalman_ros.control.planning import ReferenceMotion
from kalman_ros.core import Array, ArrayLike
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.scenario import Scenario, motions, reference_motions
from kalman_ros.scenario.body_roles import body_of
from kalman_ros.scenario.reference_motions import along_path

from .accept import limits_given, number, numbers
from .loop_setup import Given, law_of


@knows_arguments(
    waypoints='path', points='path', T='seconds', duration='seconds', v='speed', a='acceleration'
)
def motion(
    scenario: Scenario | str | Path | Mapping[str, Any] = 'mass_spring_damper_2d',
    overrides: Mapping[str, Any] | None = None,
    *,
    path: ArrayLike | None = None,
    speed: float = 0.5,
    acceleration: float = 0.5,
    values: Mapping[str, ArrayLike] | None = None,
    times: ArrayLike | None = None,
    velocities: Mapping[str, ArrayLike] | None = None,
    start: Mapping[str, float] | None = None,
    end: Mapping[str, float] | None = None,
    seconds: float | None = None,
    tolerance: float = 0.05,
    input_limit: ArrayLike | None = None,
    input_lower_limit: ArrayLike | None = None,
    input_rate_limit: ArrayLike | None = None,
) -> Motion:
    """Return the motion of a model along a path, through values, or between states; its inputs.

    Give it to `simulate`, `monte_carlo` or `Regulator` as the ``reference``. With the law ``lqr``
    a nonlinear model is regulated along it by the time-varying LQR.

    Parameters
    ----------
    scenario, overrides
        As for `load`: the model, the law and its weights, the rate.
    path
        Points (K, 2) or (K, 3) in metres, passed from rest to rest.
    speed, acceleration
        Largest ones on the path, in m/s and m/s^2.
    values
        Instead of a path: values of states by name, (K,) each.
    times
        Seconds (K,) of the values, increasing.
    velocities
        Rates of change of the values, (K,) each; by default the motion begins and ends at rest.
    start, end
        Instead of a path: states by name, from which and to which it goes, by any way; others
        are at the equilibrium.
    seconds
        Duration of a motion from ``start`` to ``end``.
    tolerance
        How far a state may be from what is asked for, in its unit, beyond a tenth of its extent.
        Right angles of a path are cut by as much, in metres.
    input_limit, input_lower_limit, input_rate_limit
        Largest magnitude of the input, its smallest value where that is another, and its
        largest change per second; one number for all inputs.

    Raises
    ------
    ValueError
        If an argument is invalid, or no input moves the model so; the message names the state, or
        the input, and the time.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> robot = 'diff_drive', {'model_parameters.command_time': 0.2}
    >>> motion = kr.motion(*robot, path=[[0, 0], [2, 0], [2, 2]])
    >>> run = kr.simulate(*robot, seconds=motion.duration, reference=motion)
    """
    if sum(given is not None for given in (path, values, seconds)) != 1:
        raise ValueError(
            'path: expected a path, or values with their times, or the seconds from start to end'
        )
    if seconds is None and not (start is None and end is None):
        raise ValueError('start: expected the seconds of the motion with it')
    if seconds is not None and start is None and end is None:
        raise ValueError('seconds: expected a start or an end with it')
    law = law_of(
        scenario,
        overrides,
        Given(limits=limits_given(input_limit, input_lower_limit, input_rate_limit)),
    )
    allowed = number('tolerance', tolerance)
    if not 0.0 <= allowed < inf:
        raise ValueError(f'tolerance: expected a finite number of at least 0, got {allowed:g}')
    wanted: Callable[[], ReferenceMotion] | None = None
    if values is not None:
        what, given = 'values', _in_time(law.scenario, values, times, velocities)
        wanted = partial(reference_motions.in_time, law.scenario, *given)
    elif seconds is not None:
        what = 'start and end'
        states = _state(law.scenario, 'start', start), _state(law.scenario, 'end', end)
        duration = _positive('seconds', seconds)
        wanted = partial(reference_motions.between, law.scenario, *states, duration)
    else:
        what, points = 'path', _points(path)
        _refuse_unused(law.scenario, points)
        limits = _positive('speed', speed), _positive('acceleration', acceleration)
        paced = partial(along_path, law.scenario, points, *limits, rounding=allowed)
    try:
        reference = paced if wanted is None else wanted()
        return motions.motion_of(law.scenario, reference, law.limits, allowed)
    except ValueError as error:
        raise ValueError(f'{what}: {error}') from None


def _state(scenario: Scenario, name: str, named: Mapping[str, float] | None) -> Array:
    """Return a state (n,) with these coordinates, the others at the equilibrium."""
    given = {} if named is None else _by_name(name, named)
    state: Array = scenario.model.equilibrium.state.copy()
    state[scenario.model.state.indices(given, name)] = [
        number(f'{name}.{coordinate}', value) for coordinate, value in given.items()
    ]
    return state


def _by_name(what: str, given: Any) -> dict[str, Any]:
    """Return values by name; ValueError for anything else."""
    if not isinstance(given, Mapping):
        raise ValueError(f'{what}: expected values by name, got {type(given).__name__}')
    return {str(name): value for name, value in given.items()}


def _points(path: ArrayLike | None) -> Array:
    """Return the points (K, 3) of a path, at height 0 where none is given."""
    points = numbers('path', path)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f'path: expected points of 2 or 3 numbers, got an array {points.shape}')
    return np.hstack((points, np.zeros((len(points), 3 - points.shape[1]))))


def _refuse_unused(scenario: Scenario, points: Array) -> None:
    """Raise ValueError if points (K, 3) differ in a direction in which a model cannot go."""
    axes = body_of(scenario.model.state, scenario.state).position
    unused = [axis for k, axis in enumerate('xyz') if axis not in axes and np.ptp(points[:, k])]
    if axes and unused:
        raise ValueError(
            f'path: expected points that differ in {", ".join(axes)} alone, the position that '
            f'this model has, got {", ".join(unused)}, too'
        )


def _positive(name: str, value: float) -> float:
    checked = number(name, value)
    if not 0.0 < checked < inf:
        raise ValueError(f'{name}: expected a positive number, got {checked:g}')
    return checked


def _in_time(
    scenario: Scenario,
    values: Mapping[str, ArrayLike],
    times: ArrayLike | None,
    velocities: Mapping[str, ArrayLike] | None,
) -> tuple[list[int], Array, Array, Array | None]:
    """Return the indices of states, the times (K,), and values and velocities (K, k) of these."""
    if times is None:
        raise ValueError('values: expected their times')
    values = _by_name('values', values)
    clock = _finite('times', times)
    index = scenario.model.state.indices(values, 'values')
    curve = _table('values', values, len(clock))
    if velocities is None:
        return index, clock, curve, None
    if [*_by_name('velocities', velocities)] != [*values]:
        raise ValueError(f'velocities: expected those of {", ".join(values)}')
    return index, clock, curve, _table('velocities', velocities, len(clock))


def _table(what: str, values: Mapping[str, ArrayLike], count: int) -> Array:
    """Return the values as columns (K, k)."""
    rows = {name: _finite(f'{what}.{name}', value) for name, value in values.items()}
    if not rows:
        raise ValueError(f'{what}: expected the values of a state or more')
    for name, row in rows.items():
        if len(row) != count:
            expected = f'expected {count} numbers, one a time, got {len(row)}'
            raise ValueError(f'{what}.{name}: {expected}')
    return np.column_stack([*rows.values()])


def _finite(name: str, value: ArrayLike) -> Array:
    """Return finite numbers (K,)."""
    row = numbers(name, value).ravel()
    if not np.isfinite(row).all():
        raise ValueError(f'{name}: expected finite numbers')
    return row
