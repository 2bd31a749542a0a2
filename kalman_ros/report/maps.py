# SPDX-License-Identifier: Apache-2.0
"""Map of a run in a plane: tracks, covariance ellipses, bearings and sensors."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .ellipse import outline
from .style import BOUND, ESTIMATE, INPUT, READING, SIGMAS, TRUTH, canvas, legend_below

#: Pieces of a track, each less pale than the one before, and the opacity of the first.
_FADES, _FAINTEST, _POWER = 24, 0.15, 2.5
#: Names of states that are a position in a plane, in order of preference.
PLANES = (('x', 'y'), ('x', 'z'))
#: Numbers of ellipses, of bearings of each sensor, and of readings of the position.
_ELLIPSES, _BEARINGS, _READINGS = 12, 15, 300
#: Margin around the tracks, as a share of their size.
_MARGIN = 0.25
#: Ratio of the width of the map to its height.
_ASPECT = 1.3
#: An ellipse below this share of the map is drawn again in an enlarged inset.
_SMALL = 0.03


class Sight(NamedTuple):
    """The bearings of a sensor: ``time`` (N,), ``angle`` (N,), and its position (N, 2)."""

    time: Array
    angle: Array
    place: Array


def plane(space: Space) -> tuple[int, int] | None:
    """Return the indices of the two states that are a position in a plane; None without them."""
    for names in PLANES:
        if set(names) <= set(space.names):
            first, second = space.indices(names)
            return first, second
    return None


def observer(scenario: Scenario, run: Trajectory) -> Array | None:
    """Return the track (N, 2) of the observer to which the state is relative; None without one.

    The state is relative if the input accelerates the observer, p' = v, v' = w - a. The track
    starts at the origin and at rest, so velocities are relative to the velocity at the start.
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


def route(
    scenario: Scenario, run: Trajectory, path: Path | None, followed: Array | None = None
) -> Any:
    """Draw the true and the estimated track, ellipses, bearing lines and positions of sensors.

    ``followed`` is the path (k, 2) that the controller was given, if any.

    Raises
    ------
    ValueError
        If the state has no position in a plane.
    """
    space = scenario.model.state
    indices = plane(space)
    if indices is None:
        raise ValueError(f'state: expected x and y, or x and z, got {", ".join(space.names)}')
    places = list(indices)
    observer_track = observer(scenario, run)
    offset = np.zeros((len(run.time), 2)) if observer_track is None else observer_track
    truth, mean = run.truth[:, places] + offset, run.estimate[:, places] + offset
    covariance = run.covariance[:, places][:, :, places]
    with canvas(
        path, (6.4, 5.4), 'Where it was, and was thought to be; the past fades.'
    ) as figure:
        axis = figure.subplots()
        _draw_readings(axis, scenario, run, [space.names[index] for index in places])
        origins = _draw_bearings(axis, list(sights(scenario, run)), truth)
        for k, step in enumerate(np.linspace(0, len(mean) - 1, _ELLIPSES).astype(int)):
            label = f'estimate, {SIGMAS:g} sigma' if k == 0 else None
            ellipse = outline(mean[step], covariance[step], SIGMAS)
            axis.fill(*ellipse.T, color=BOUND, alpha=0.35, lw=0, label=label)
        if followed is not None:
            axis.plot(*followed.T, '--', color=INPUT, lw=1.2, label='path')
        _fading(axis, truth, TRUTH, 2.0, 'truth')
        _fading(axis, mean, ESTIMATE, 0.9, 'estimate')
        axis.plot(*truth[0], 'o', color=TRUTH, ms=4)
        if observer_track is not None:
            axis.plot(*observer_track.T, color=INPUT, lw=1.2, label='observer')
        for origin in origins:
            axis.plot(*origin[0], '^', color=TRUTH if observer_track is None else INPUT, ms=7)
        frame(axis, np.vstack([truth, offset if observer_track is not None else truth, *origins]))
        magnified(axis, truth[-1], mean[-1], covariance[-1], 'the end')
        axis.set_xlabel(space.label(space.names[indices[0]]))
        axis.set_ylabel(space.label(space.names[indices[1]]))
        axis.set_title('Track; the dot is the start' + (', triangles sensors' if origins else ''))
        legend_below(figure, axis)
    return axis


def _fading(axis: Any, track: Array, colour: str, width: float, label: str) -> None:
    """Draw a track (N, 2) that is the paler the older it is."""
    edges = np.linspace(0, len(track), _FADES + 1).astype(int)
    for k, (first, last) in enumerate(pairwise(edges)):
        alpha = _FAINTEST + (1.0 - _FAINTEST) * ((k + 1) / _FADES) ** _POWER
        named = label if k == _FADES - 1 else None
        axis.plot(*track[first : last + 1].T, color=colour, lw=width, alpha=alpha, label=named,
                  solid_capstyle='butt')  # fmt: skip


def frame(axis: Any, shown: Array) -> None:
    """Set the limits of the axis such that it shows points (N, 2) and a margin, to scale."""
    low, high = shown.min(axis=0), shown.max(axis=0)
    size = high - low + 2.0 * _MARGIN * max(float(np.max(high - low)), 1e-9)
    # extend the shorter side to the aspect ratio of the panel
    half = 0.5 * np.maximum(size, size[::-1] * (_ASPECT, 1.0 / _ASPECT))
    middle = 0.5 * (low + high)
    axis.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axis.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axis.set_aspect('equal')


def magnified(axis: Any, truth: Array, mean: Array, covariance: Array, label: str) -> None:
    """Draw an estimate of a position (2,) in an enlarged inset if it is too small to see."""
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
    inset.set_xlabel(f'{label}, {_round_length(2.0 * reach)} m wide', fontsize=7, labelpad=2)


def _round_length(length: float) -> str:
    """Return a length as text with two significant digits."""
    return f'{float(f"{length:.2g}"):g}'


def _draw_readings(axis: Any, scenario: Scenario, run: Trajectory, names: list[str]) -> None:
    """Draw a sample of the readings of each sensor that measures the position."""
    label: str | None = 'reading'
    for name, source in scenario.enabled.items():
        output, values = source.sensor.output, run.readings[name].values
        if {*names} <= {*output.names} and len(values):
            step = -(-len(values) // _READINGS)
            drawn = values[::step, output.indices(names)]
            axis.plot(*drawn.T, '.', ms=2.0, color=READING, alpha=0.6, label=label)
            label = None


def _draw_bearings(axis: Any, visible: list[Sight], truth: Array) -> list[Array]:
    """Draw a sample of the bearings of each sensor; return the initial positions of sensors."""
    for sight in visible:
        reach = 3.0 * float(np.max(np.linalg.norm(truth - sight.place[0], axis=1)))
        for k in np.linspace(0, len(sight.time) - 1, _BEARINGS).astype(int):
            ray = np.array([np.cos(sight.angle[k]), np.sin(sight.angle[k])])
            ends = np.stack((sight.place[k], sight.place[k] + reach * ray))
            axis.plot(*ends.T, color=READING, lw=0.5)
    if visible:
        axis.plot([], [], color=READING, lw=0.5, label='bearing')
    return [sight.place[:1] for sight in visible]


def sights(scenario: Scenario, run: Trajectory) -> Iterator[Sight]:
    """Yield the bearings of each sensor that measures them, in the axes of the map."""
    track = observer(scenario, run)
    for name, source in scenario.enabled.items():
        series = run.readings[name]
        if 'bearing' not in source.sensor.output.names or not len(series.time):
            continue
        angle = series.values[:, source.sensor.output.names.index('bearing')]
        place = np.asarray(getattr(source.sensor, 'position', np.zeros(2)), dtype=float)
        places = np.tile(place, (len(angle), 1))
        if track is not None:
            places += np.stack([np.interp(series.time, run.time, x) for x in track.T], axis=1)
        yield Sight(series.time, angle, places)
