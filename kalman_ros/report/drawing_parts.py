# SPDX-License-Identifier: Apache-2.0
"""Parts of the drawings of systems: springs, arrows, bearings, vehicles."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.patches import FancyArrow, Polygon

from kalman_ros.core import Array
from kalman_ros.simulation.trajectory import Series

from .maps import Sight
from .style import BOUND, ESTIMATE, INPUT, READING, TRUTH

TRUTH_LOOK: dict[str, Any] = {'color': TRUTH, 'lw': 2.2}
ESTIMATE_LOOK: dict[str, Any] = {'color': ESTIMATE, 'lw': 1.4, 'ls': '--'}
BAND_LOOK: dict[str, Any] = {'color': BOUND, 'alpha': 0.35, 'lw': 0}


def window(axis: Any, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Show a part of the world to scale, without ticks on an unlabelled vertical axis."""
    axis.set_xlim(*x)
    axis.set_ylim(*y)
    axis.set_aspect('equal')
    if not axis.get_ylabel():
        axis.set_yticks(())


def coil(axis: Any, start: Any, end: Any, wide: float) -> None:
    """Draw a spring between two points."""
    a, b = np.array(start), np.array(end)
    t = np.concatenate(([0.0], np.linspace(0.08, 0.92, 19), [1.0]))
    offset = np.concatenate(([0.0], np.resize((wide, -wide), 19), [0.0]))
    direction = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    normal = np.array([-direction[1], direction[0]])
    axis.plot(*(a + np.outer(t, b - a) + np.outer(offset, normal)).T, color=READING, lw=1.0)


def arrow(axis: Any, start: Any, size: Any, reach: float) -> None:
    """Draw an input as an arrow, unless it is too small to see."""
    if np.hypot(*size) > 0.01 * reach:
        head = 0.06 * reach
        axis.add_patch(FancyArrow(*start, *size, width=0.015 * reach, head_width=head,
                                  head_length=head, color=INPUT, lw=0, zorder=4))  # fmt: skip


def cross(axis: Any, read: Series, columns: list[int], time: float) -> None:
    """Draw the last reading (2,) of a position as a cross."""
    k = int(np.searchsorted(read.time, time + 1e-9)) - 1
    if k >= 0:
        axis.plot(*read.values[k, columns], 'x', color=READING, ms=8, mew=2.0)


def ray(axis: Any, sight: Sight, time: float, far: float) -> None:
    """Draw the last bearing of a sensor as a ray."""
    k = int(np.searchsorted(sight.time, time + 1e-9)) - 1
    if k >= 0:
        direction = np.array([np.cos(sight.angle[k]), np.sin(sight.angle[k])])
        ends = np.stack((sight.place[k], sight.place[k] + far * direction))
        axis.plot(*ends.T, color=READING, lw=1.0)


def vehicle(axis: Any, place: Array, heading: float, size: float) -> None:
    """Draw a vehicle as an arrowhead that points along its heading."""
    shape = size * np.array([[1.5, 0.0], [-1.0, 0.9], [-0.5, 0.0], [-1.0, -0.9]])
    rotation = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    axis.add_patch(Polygon(place + shape @ rotation.T, fill=False, color=TRUTH, lw=1.8))
