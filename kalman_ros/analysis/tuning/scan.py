# SPDX-License-Identifier: Apache-2.0
"""A scan of parameters whose likelihood has several maxima, such as delays.

A late sensor follows each turn of a robot, so a delay that is wrong by the time between two turns
is a maximum of the likelihood, too. No ascent leaves it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from kalman_ros.core import Array

from .likelihood import Likelihood

#: A part of the recording tells values apart if their log-likelihoods differ by more than this.
_DIFFERENT = 10.0
#: Number of times that the spacing is halved about the best value.
_HALVED = 2


def scanned(likelihood: Likelihood, readings: int, report: Callable[[str, float], None]) -> Array:
    """Return the start (p,) with the best value of each parameter that has a ``scan``.

    Each is scanned between its bounds with the others as they are. The first ``readings`` are used
    for it, or twice the number until they tell the values apart.
    """
    z = likelihood.start
    for index, free in enumerate(likelihood.parameters):
        if not free.scan:
            continue
        low, high = free.limits
        spacing = free.scan / free.scale
        below, above = np.arange(z[index], low, -spacing), np.arange(z[index], high, spacing)
        grid = np.unique(np.concatenate((below, above)))
        count, part = readings, likelihood.first(readings)
        while True:
            values = _values(part, z, index, grid, partial(report, f'scanning {free.name}'))
            defined = values[np.isfinite(values)]
            if part is likelihood or (len(defined) and np.ptp(defined) > _DIFFERENT):
                break
            count *= 2
            part = likelihood.first(count)
        for _ in range(_HALVED):
            z[index] = grid[np.argmax(values)]
            spacing *= 0.5
            grid = np.clip(z[index] + spacing * np.array([0.0, -1.0, 1.0]), low, high)
            values = _values(part, z, index, grid)
        z[index] = grid[np.argmax(values)]
    return z


def _values(
    likelihood: Likelihood,
    z: Array,
    index: int,
    grid: Sequence[float] | Array,
    progress: Callable[[float], None] = lambda share: None,
) -> Array:
    """Return the log-likelihood with each value of one parameter, each in a separate pass."""
    values = np.empty(len(grid))
    for row, value in enumerate(grid):
        point = z.copy()
        point[index] = value
        values[row] = likelihood.values([point])[0]
        progress((row + 1) / len(grid))
    return values
