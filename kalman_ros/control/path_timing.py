# SPDX-License-Identifier: Apache-2.0
"""When to be where along a path: from points in space to positions in time."""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np

from kalman_ros.core import Array

#: The number of places along a path at which its speed is computed.
_FEWEST, _MOST = 200, 20_000
#: That number for each distance in which the speed is reached.
_FINE = 20
#: The speeds that are tried, from the slowest one, relative to the largest.
_SPEEDS, _SLOWEST = 21, 1.0 / 32.0
#: Points nearer than this, in metres, are the same.
_APART = 1e-9


def timed_path(
    points: Array,
    speed: float,
    acceleration: float,
    rounding: float,
    dt: float,
    most: int,
    first_speed: float = 0.0,
) -> Array:
    """Return positions (N + 1, d) in steps of ``dt`` along the polygon through ``points``.

    The motion ends at rest, and begins at the ``first_speed``. It is slower where the path bends:
    the acceleration across it is at most about ``acceleration``, as along it. Corners are rounded
    by the mean over a time T: a right angle is cut by a T^2 / 8.

    Parameters
    ----------
    points
        Positions (K, d) in metres; the same point twice in a row counts once.
    speed
        Largest speed in m/s.
    acceleration
        Largest acceleration in m/s^2.
    rounding
        Distance in metres by which a right angle is cut, at most.
    dt
        Length of a step in seconds.
    most
        The largest allowed N.
    first_speed
        Speed in m/s at the first point; less if the path bends or ends too soon for it.

    Raises
    ------
    ValueError
        If there are fewer than two different points, or the motion has more than ``most`` steps.
    """
    moved = np.append(True, np.any(np.abs(np.diff(points, axis=0)) > _APART, axis=1))
    corners = points[moved]
    if len(corners) < 2:
        raise ValueError(f'expected two different points or more, got {len(points)}, all the same')
    with np.errstate(over='ignore', invalid='ignore'):
        s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    length, mean = float(s[-1]), min(speed / acceleration, sqrt(8.0 * rounding / acceleration))
    if not length < np.inf:
        raise ValueError('expected positions whose distances are finite')
    if length / speed > most * dt:
        raise ValueError(
            f'{length:.4g} m at {speed:g} m/s take {length / speed:.4g} s: expected at most '
            f'{most} steps, {most * dt:.4g} s'
        )
    count = int(np.clip(ceil(_FINE * length / (speed * max(mean, dt))), _FEWEST, _MOST))
    at = np.linspace(0.0, length, count + 1)
    v = _speeds(_along(corners, s, at), at, speed, acceleration, mean, first_speed)
    # constant acceleration between two places: the time is the distance by the mean speed
    t = np.append(0.0, np.cumsum(2.0 * np.diff(at) / (v[1:] + v[:-1])))
    steps = ceil(t[-1] / dt)
    half = round(0.5 * mean / dt)
    if steps + 2 * half > most:
        raise ValueError(
            f'the path bends so much that it takes {t[-1]:.4g} s: expected at most {most} steps, '
            f'{most * dt:.4g} s'
        )
    before = half if v[0] > 0.0 else 2 * half  # at rest, the mean begins to move earlier
    clock = np.minimum(np.arange(-before, steps + 2 * half + 1) * dt, t[-1])
    moving, clock = clock >= 0.0, np.maximum(clock, 0.0)
    place = np.clip(np.searchsorted(t, clock, 'right') - 1, 0, count - 1)
    since = clock - t[place]
    gain = (np.diff(v) / np.diff(t))[place]
    passed = at[place] + since * (v[place] + 0.5 * gain * since)
    positions = _along(corners, s, passed)
    earlier = np.arange(-before, 0) * dt * v[0]  # a continuation of the first line
    direction = (corners[1] - corners[0]) / s[1]
    positions[~moving] += earlier[:, np.newaxis] * direction
    return _smooth(positions, half)


def headings(positions: Array) -> Array:
    """Return the direction (N + 1,) of the velocity in the plane, continuous; held at rest."""
    step = np.diff(positions[:, :2], axis=0)
    moving = np.linalg.norm(step, axis=1) > 1e-9
    if not moving.any():
        return np.zeros(len(positions))
    angle = np.unwrap(np.arctan2(step[moving, 1], step[moving, 0]))
    index = np.flatnonzero(moving)
    return np.asarray(np.interp(np.arange(len(positions)) - 0.5, index, angle))


def interpolated(
    times: Array,
    values: Array,
    dt: float,
    velocities: Array | None = None,
    first: Array | None = None,
) -> Array:
    """Return values (N + 1, k) in steps of ``dt`` from those at ``times`` (K,).

    Cubic polynomials join the points, with the given ``velocities`` (K, k), or those of the
    spline that begins with the ``first`` velocity (k,), by default zero, and ends at rest (C. de
    Boor, A Practical Guide to Splines, 2001, chapter IV).
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline  # only with a motion

    rest = np.zeros(values.shape[1])
    curve = (
        CubicSpline(times, values, bc_type=((1, rest if first is None else first), (1, rest)))
        if velocities is None
        else CubicHermiteSpline(times, values, velocities)
    )
    steps = max(round((times[-1] - times[0]) / dt), 1)
    clock = np.minimum(times[0] + np.arange(steps + 1) * dt, times[-1])
    return np.asarray(curve(clock))


def _along(corners: Array, s: Array, at: Array) -> Array:
    """Return the positions (..., d) at distances from the start of a polygon."""
    return np.column_stack([np.interp(at, s, coordinate) for coordinate in corners.T])


def _speeds(
    places: Array, at: Array, speed: float, acceleration: float, mean: float, first: float
) -> Array:
    """Return the largest speed at each place that respects the acceleration.

    At speed v the ``mean`` over a time T is one over a length w = v T, within which the direction
    turns by an angle phi: the acceleration across the path is v phi / T. A bend of radius r, phi
    = w / r, has the speed sqrt(acceleration r); a corner has that at which it is rounded.
    """
    step = at[1] - at[0]
    v = np.full(len(places), speed * _SLOWEST)
    for candidate in speed * np.geomspace(_SLOWEST, 1.0, _SPEEDS):
        window = min(max(round(candidate * mean / step), 1), len(places) - 1)
        v[candidate * _turn(places, window) <= acceleration * mean] = candidate
    v[0], v[-1] = min(first, speed), 0.0
    squares, gain = np.square(v), 2.0 * acceleration * step
    for way in (squares, squares[::-1]):
        for k in range(1, len(way)):
            way[k] = min(way[k], way[k - 1] + gain)
    return np.asarray(np.sqrt(squares))


def _turn(places: Array, window: int) -> Array:
    """Return the angle at each place between the chords over a ``window`` before and after it."""
    padded = np.pad(places, ((window, window), (0, 0)), mode='edge')
    before, after = places - padded[: len(places)], padded[2 * window :] - places
    sizes = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    cosine = np.divide(
        np.sum(before * after, axis=1), sizes, out=np.ones(len(places)), where=sizes > 0.0
    )
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _smooth(positions: Array, half: int) -> Array:
    """Return the means over ``half`` positions to both sides, without the ends that have fewer."""
    if not half:
        return positions
    total = np.cumsum(np.vstack((np.zeros(positions.shape[1]), positions)), axis=0)
    width = 2 * half + 1
    return np.asarray((total[width:] - total[:-width]) / width)
