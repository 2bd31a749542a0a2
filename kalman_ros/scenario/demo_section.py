# SPDX-License-Identifier: Apache-2.0
"""The section of a parameter file for the program that runs a scenario for people."""

from __future__ import annotations

from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.core import Array

from .parameter_files import own_section

_NAME = 'demo'


class Demo(NamedTuple):
    """What a parameter file has for its demo.

    ``duration`` is in seconds, None if it has none; ``time_unit`` is written on pictures, for the
    scenarios in which a second stands for another time; ``parameters`` are for every node.
    ``path`` has the positions (k, 2) of a path to follow, or is None.
    """

    duration: float | None
    time_unit: str
    parameters: dict[str, Any]
    path: Array | None = None

    @property
    def rate_unit(self) -> str:
        """The unit of rates: Hz, or per year where a second stands for a year."""
        return 'Hz' if self.time_unit == 's' else f'per {self.time_unit.removesuffix("s")}'


def demo_section(path: Path | None) -> Demo:
    """Return the section of the demo in a ROS parameter file.

    Raises
    ------
    ValueError
        If the file is not a ROS parameter file, the duration no number, the unit no word, or the
        path no list of positions.
    """
    section = own_section(path, _NAME)
    duration, unit = section.pop('duration', None), section.pop('time_unit', 's')
    if duration is not None and (isinstance(duration, bool) or not isinstance(duration, Real)):
        raise ValueError(f"{_NAME}: duration: expected a number, got '{duration}'")
    if not isinstance(unit, str):
        raise ValueError(f"{_NAME}: time_unit: expected a word, got '{unit}'")
    points = _positions(section.pop('path', None))
    return Demo(None if duration is None else float(duration), unit, section, points)


def _positions(numbers: Any) -> Array | None:
    """Return the positions (k, 2) of x, y, x, y and so on."""
    if numbers is None:
        return None
    try:
        points = np.asarray(numbers, dtype=float).reshape(-1, 2)
    except (TypeError, ValueError):
        points = np.empty((0, 2))
    if len(points) < 2 or not np.isfinite(points).all():
        raise ValueError(f"{_NAME}: path: expected x, y of two positions or more, got '{numbers}'")
    return points
