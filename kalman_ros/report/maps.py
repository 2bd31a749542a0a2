# SPDX-License-Identifier: Apache-2.0
"""The map of a run in a plane: tracks, covariance ellipses, bearings and sensors."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .ellipse import outline
from .style import BOUND, ESTIMATE, INPUT, READING, TRUTH, canvas, legend_below

#: States that are a place in a plane, in the order of preference.
PLANES = (('x', 'y'), ('x', 'z'))
SIGMAS = 3.0
#: The number of ellipses, of bearings of each sensor, and of readings of a place.
_ELLIPSES, _BEARINGS, _READINGS = 12, 15, 300
#: What lies further outside than this share of the tracks' size is cut off.
_MARGIN = 0.25
#: The width of the map by its height.
_ASPECT = 1.3
#: An ellipse below this share of the map is drawn again, larger.
_SMALL = 0.03


class Sight(NamedTuple):
    """The bearings of a sensor: ``time`` (N,), ``angle`` (N,) and its place at each (N, 2)."""

    time: Array
    angle: Array
    place: Array


def plane(space: Space) -> tuple[int, int] | None:
    """Return the indices of the two states that are a place in a plane; None without them."""
    for names in PLANES:
        if set(names) <= set(space.names):
            first, second = space.indices(names)
            return first, second
    return None


def observer(scenario: Scenario, run: Trajectory) -> Array | None:
    """Return the track (N, 2) of the observer that a state is relative to; None without one.

    The state is relative where the input accelerates the observer, p' = v, v' = w - a. The
    track starts at the origin, at rest: velocities are relative to that of the start.
    """
    model: Any = scenario.model
    if not model.is_linear or model.is_discrete or model.state.names[:2] != ('x', 'y'):
        return None
    if model.B.shape != (4, 2) or not np.array_equal(model.B, -np.eye(4)[:, 2:]):
        return None
    a, dt = run.input[:-1], np.diff(run.time)[:, np.newaxis]
    start = np.zeros((1, 2))
    v = np.vstack((start, np.cumsum(a * dt, axis=0)))
    return np.vstack((start, np.cumsum(v[:-1] * dt + 0.5 * a * dt**2, axis=0)))


def route(scenario: Scenario, run: Trajectory, path: Path | None) -> Any:
    """Draw the true and the estimated track, ellipses, bearing lines and places of sensors.

    Raises
    ------
    ValueError
        If the state is not a place in a plane.
    """
    space = scenario.model.state
    at = plane(space)
    if at is None:
        raise ValueError(f'state: expected x and y, or x and z, got {", ".join(space.names)}')
    places = list(at)
    own = observer(scenario, run)
    moved = np.zeros((len(run.time), 2)) if own is None else own
    truth, mean = run.truth[:, places] + moved, run.estimate[:, places] + moved
    covariance = run.covariance[:, places][:, :, places]
    with canvas(path, (6.4, 5.2)) as figure:
        axis = figure.subplots()
        _readings(axis, scenario, run, [space.names[index] for index in places])
        origins = _bearings(axis, list(sights(scenario, run)), truth)
        for k, step in enumerate(np.linspace(0, len(mean) - 1, _ELLIPSES).astype(int)):
            label = f'estimate, {SIGMAS:g} sigma' if k == 0 else None
            ellipse = outline(mean[step], covariance[step], SIGMAS)
            axis.fill(*ellipse.T, color=BOUND, alpha=0.35, lw=0, label=label)
        axis.plot(*mean.T, color=ESTIMATE, lw=1.0, label='estimate')
        axis.plot(*truth.T, color=TRUTH, lw=0.8, label='truth')
        axis.plot(*truth[0], 'o', color=TRUTH, ms=4)
        if own is not None:
            axis.plot(*own.T, color=INPUT, lw=1.2, label='observer')
        for origin in origins:
            axis.plot(*origin[0], '^', color=TRUTH if own is None else INPUT, ms=7)
        frame(axis, np.vstack([truth, moved if own is not None else truth, *origins]))
        magnified(axis, truth[-1], mean[-1], covariance[-1], 'the end')
        axis.set_xlabel(space.label(space.names[at[0]]))
        axis.set_ylabel(space.label(space.names[at[1]]))
        axis.set_title('Track; the dot is the start' + (', triangles sensors' if origins else ''))
        legend_below(figure, axis)
    return axis


def frame(axis: Any, shown: Array) -> None:
    """Show these points (N, 2) and a margin, to scale."""
    low, high = shown.min(axis=0), shown.max(axis=0)
    size = high - low + 2.0 * _MARGIN * max(float(np.max(high - low)), 1e-9)
    # the shorter side grows to that of the panel
    half = 0.5 * np.maximum(size, size[::-1] * (_ASPECT, 1.0 / _ASPECT))
    middle = 0.5 * (low + high)
    axis.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axis.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axis.set_aspect('equal')


def magnified(axis: Any, truth: Array, mean: Array, covariance: Array, label: str) -> None:
    """Draw an estimate of a place (2,) again in a corner, where it would be too small to see."""
    ellipse = outline(mean, covariance, SIGMAS)
    size = float(np.max(np.abs(np.vstack((ellipse, truth)) - mean)))
    if size > _SMALL * float(np.ptp(axis.get_xlim())):
        return
    inset = axis.inset_axes((0.05, 0.76, 0.22, 0.22))
    inset.fill(*ellipse.T, color=BOUND, alpha=0.35, lw=1)
    inset.plot(*mean, '+', color=ESTIMATE, ms=7)
    inset.plot(*truth, 'o', color=TRUTH, ms=3)
    reach = 1.2 * max(size, 1e-9)
    inset.set_xlim(mean[0] - reach, mean[0] + reach)
    inset.set_ylim(mean[1] - reach, mean[1] + reach)
    inset.set_aspect('equal')
    inset.set_xticks(())
    inset.set_yticks(())
    inset.spines[['top', 'right']].set_visible(True)
    inset.set_xlabel(f'{label}, {_rounded(2.0 * reach)} m wide', fontsize=7, labelpad=2)


def _rounded(length: float) -> str:
    """Return a length with two digits, without an exponent where it is not long."""
    return f'{float(f"{length:.2g}"):g}'


def _readings(axis: Any, scenario: Scenario, run: Trajectory, names: list[str]) -> None:
    """Draw some readings of each sensor that measures the place."""
    label: str | None = 'reading'
    for name, source in scenario.enabled.items():
        output, values = source.sensor.output, run.readings[name].values
        if {*names} <= {*output.names} and len(values):
            step = -(-len(values) // _READINGS)
            drawn = values[::step, output.indices(names)]
            axis.plot(*drawn.T, '.', ms=2.0, color=READING, alpha=0.6, label=label)
            label = None


def _bearings(axis: Any, seen: list[Sight], truth: Array) -> list[Array]:
    """Draw some bearings of each sensor, and return where these sensors are at first."""
    for sight in seen:
        reach = 3.0 * float(np.max(np.linalg.norm(truth - sight.place[0], axis=1)))
        for k in np.linspace(0, len(sight.time) - 1, _BEARINGS).astype(int):
            ray = np.array([np.cos(sight.angle[k]), np.sin(sight.angle[k])])
            ends = np.stack((sight.place[k], sight.place[k] + reach * ray))
            axis.plot(*ends.T, color=READING, lw=0.5)
    if seen:
        axis.plot([], [], color=READING, lw=0.5, label='bearing')
    return [sight.place[:1] for sight in seen]


def sights(scenario: Scenario, run: Trajectory) -> Iterator[Sight]:
    """Yield the bearings of each sensor that has them, in the axes of the map."""
    own = observer(scenario, run)
    for name, source in scenario.enabled.items():
        series = run.readings[name]
        if 'bearing' not in source.sensor.output.names or not len(series.time):
            continue
        angle = series.values[:, source.sensor.output.names.index('bearing')]
        place = np.asarray(getattr(source.sensor, 'position', np.zeros(2)), dtype=float)
        places = np.tile(place, (len(angle), 1))
        if own is not None:
            places += np.stack([np.interp(series.time, run.time, x) for x in own.T], axis=1)
        yield Sight(series.time, angle, places)
