# SPDX-License-Identifier: Apache-2.0
"""The map of a run in a plane: tracks, covariance ellipses, bearings and sensors."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .ellipse import outline
from .style import BOUND, ESTIMATE, READING, TRUTH, canvas, legend_below

#: States that are a place in a plane, in the order of preference.
PLANES = (('x', 'y'), ('x', 'z'))
SIGMAS = 3.0
#: The number of ellipses, and of bearings of each sensor.
_ELLIPSES, _BEARINGS = 12, 15
#: What lies further outside than this share of the tracks' size is cut off.
_MARGIN = 0.25


def plane(space: Space) -> tuple[int, int] | None:
    """Return the indices of the two states that are a place in a plane; None without them."""
    for names in PLANES:
        if set(names) <= set(space.names):
            first, second = space.indices(names)
            return first, second
    return None


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
    truth, mean = run.truth[:, places], run.estimate[:, places]
    with canvas(path, (6.4, 5.2)) as figure:
        axis = figure.subplots()
        origins = _bearings(axis, scenario, run)
        for k, step in enumerate(np.linspace(0, len(mean) - 1, _ELLIPSES).astype(int)):
            ellipse = outline(mean[step], run.covariance[step][np.ix_(places, places)], SIGMAS)
            label = f'estimate, {SIGMAS:g} sigma' if k == 0 else None
            axis.fill(*ellipse.T, color=BOUND, alpha=0.35, lw=0, label=label)
        axis.plot(*mean.T, color=ESTIMATE, lw=1.0, label='estimate')
        axis.plot(*truth.T, color=TRUTH, lw=0.8, label='truth')
        axis.plot(*truth[0], 'o', color=TRUTH, ms=4)
        for origin in origins:
            axis.plot(*origin, '^', color=TRUTH, ms=7)
        shown = np.vstack([truth, *(origin[np.newaxis] for origin in origins)])
        low, high = shown.min(axis=0), shown.max(axis=0)
        margin = _MARGIN * max(float(np.max(high - low)), 1e-9)
        axis.set_xlim(low[0] - margin, high[0] + margin)
        axis.set_ylim(low[1] - margin, high[1] + margin)
        axis.set_aspect('equal')
        axis.set_xlabel(space.label(space.names[at[0]]))
        axis.set_ylabel(space.label(space.names[at[1]]))
        axis.set_title('Track; the dot is the start' + (', triangles sensors' if origins else ''))
        legend_below(figure, axis)
    return axis


def _bearings(axis: Any, scenario: Scenario, run: Trajectory) -> list[Array]:
    """Draw some bearings of each sensor that has them, and return the places of these sensors."""
    origins: list[Array] = []
    for name, column, origin in _bearing_sensors(scenario):
        series = run.readings[name]
        if not len(series.time):
            continue
        reach = 2.0 * float(np.max(np.linalg.norm(run.truth[:, list(_places(scenario))], axis=1)))
        for k in np.linspace(0, len(series.time) - 1, _BEARINGS).astype(int):
            angle = series.values[k, column]
            end = origin + (reach + np.linalg.norm(origin)) * np.array(
                [np.cos(angle), np.sin(angle)]
            )
            axis.plot(*np.stack((origin, end)).T, color=READING, lw=0.5)
        axis.plot([], [], color=READING, lw=0.5, label=None if origins else 'bearing')
        origins.append(origin)
    return origins


def _places(scenario: Scenario) -> tuple[int, int]:
    at = plane(scenario.model.state)
    assert at is not None
    return at


def _bearing_sensors(scenario: Scenario) -> Iterator[tuple[str, int, Array]]:
    """Yield each sensor with a bearing, the column of the bearing, and the sensor's place."""
    for name, source in scenario.enabled.items():
        if 'bearing' in source.sensor.output.names:
            column = source.sensor.output.names.index('bearing')
            yield name, column, np.asarray(getattr(source.sensor, 'position', np.zeros(2)))
