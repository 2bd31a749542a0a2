# SPDX-License-Identifier: Apache-2.0
"""A path that a user draws on a live page, and what the controller reports about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of

from .adjustments import Adjustments
from .page_command import are_numbers

#: Largest number of points, and largest magnitude of a coordinate in metres.
_MOST, _FARTHEST = 200, 1e6
#: Number of directions of a map.
_PLANE = 2


def map_axes(scenario: Scenario) -> tuple[str, ...]:
    """Return the directions of a map, of x, y and z; empty without a map."""
    axes = body_of(scenario.model.state, scenario.state).position[:_PLANE]
    return axes if len(axes) == _PLANE else ()


def described(adjustments: Adjustments) -> dict[str, Any]:
    """Return for JSON how a path is drawn, with the ``reason`` for which none can be, or ''."""
    plant = adjustments.scenario('plant')
    axes = map_axes(plant)
    state, body = plant.model.state, body_of(plant.model.state, plant.state)
    reason = ''
    if not adjustments.driven:
        reason = 'the model has no input, so nothing moves it along a path'
    elif not axes:
        reason = 'the state has no position in a plane'
    return {'names': [state.names[body.index[axis]] for axis in axes], 'reason': reason}


def points_of(scenario: Scenario, given: Sequence[Any]) -> Array:
    """Return the points (K, 3) of a path that is drawn on the map of a scenario.

    Raises
    ------
    ValueError
        If there is no map, or the points are not pairs of numbers.
    """
    axes = map_axes(scenario)
    if not axes:
        raise ValueError('path: the state has no position in a plane')
    if not 2 <= len(given) <= _MOST or not all(
        are_numbers(pair, _PLANE, _FARTHEST) for pair in given
    ):
        raise ValueError(f'path: expected 2 to {_MOST} pairs of numbers up to {_FARTHEST:g}')
    points = np.zeros((len(given), 3))
    points[:, ['xyz'.index(axis) for axis in axes]] = given
    return points


@dataclass
class DrawnPath:
    """The path that was drawn last, for JSON.

    Parameters
    ----------
    reported
        Returns a value that the controller reports, by its key; '' if it is missing.
    """

    reported: Callable[[str], str]
    points: list[Any] = field(default_factory=list)
    _planned: int = 0
    _refused: int = 0

    def draw(self, points: Sequence[Any]) -> None:
        """Replace the path, before it is published."""
        self.points = list(points)
        self._planned, self._refused = self._count('planned'), self._count('refused')

    def described(self) -> dict[str, Any]:
        """Return the path, with its state and progress in words, and the reason of a refusal."""
        state, reason = '', ''
        progress, remaining = self.reported('motion'), self.reported('remaining distance [m]')
        if self.points:
            if self._count('refused') > self._refused:
                state, reason = 'refused', self.reported('reason of the last refusal')
            elif self._count('planned') == self._planned:
                state = 'planning'
            else:
                state = 'following' if progress else 'ended'
        elif progress:
            state = 'following'
        return {
            'points': self.points, 'state': state, 'reason': reason,
            'progress': progress, 'remaining': remaining,
        }  # fmt: skip

    def _count(self, outcome: str) -> int:
        text = self.reported(f'motions {outcome}')
        return int(text) if text.isdigit() else 0
