# SPDX-License-Identifier: Apache-2.0
"""The picture of a sweep: curves over one parameter, maps over two."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.ticker import FormatStrFormatter

from kalman_ros.core import Array, Space
from kalman_ros.report.style import (
    BOUND,
    ESTIMATE,
    INPUT,
    TRUTH,
    figure_with,
    log_ticks,
    shades,
)  # fmt: skip

from .grid import Point
from .ranges import Range

_LOST = 'lost runs [%]'


def sweep_picture(
    ranges: Sequence[Range],
    state: Space,
    points: Sequence[Point],
    marks: Sequence[float | None],
    path: Path,
) -> None:
    """Draw cost, errors, ANEES and the share of lost runs, with theory where there is one.

    Parameters
    ----------
    ranges, points
        What was swept, and the outcomes.
    state
        Space of the state.
    marks
        Configured value of each swept parameter within its range, which is marked, or None.
    path
        File of the picture.
    """
    if len(ranges) == 1:
        _curves(ranges[0], state, points, marks[0], path)
    else:
        _maps(ranges, state, points, marks, path)


def _curves(
    swept: Range, state: Space, points: Sequence[Point], mark: float | None, path: Path
) -> None:
    points = [point for point in points if point.rms]
    x = [point.values[0] for point in points]
    costs = np.array([point.cost for point in points])
    rows = 3 + bool(np.isfinite(costs).any())
    shows = 'Averages of the runs at each value; dashed: theory.'
    if mark is not None:
        shows += ' Orange: the configured value.'
    with figure_with(path, rows, 1, (7.0, 1.9 * rows + 0.8), shows, sharex=True) as (_, axes):
        for axis in axes[:, 0] if mark is not None else ():
            axis.axvline(mark, color=INPUT, lw=1.0, ls=':')
        panels = list(axes[:, 0])
        if rows == 4:
            axis = panels.pop(0)
            error = 2.0 * np.array([point.cost_error for point in points])
            axis.fill_between(x, costs - error, costs + error, color=BOUND, alpha=0.35, lw=0)
            axis.plot(x, costs, '.-', color=INPUT, lw=1.0, label='measured, with 95 %')
            expected = [_or_nan(point.theory_cost) for point in points]
            _theory(axis, x, expected)
            axis.set_ylabel('cost per second')
            axis.legend()
        errors, consistency, lost = panels
        for index, (name, colour) in enumerate(zip(state.names, shades(state.size))):
            rms = [point.rms[index] for point in points]
            errors.plot(x, rms, '.-', lw=1.0, color=colour, label=state.label(name))
            expected = [
                point.theory_rms[index] if point.theory_rms else np.nan for point in points
            ]
            errors.plot(x, expected, '--', lw=0.8, color=TRUTH)
        errors.set_yscale('log')
        log_ticks(errors)
        errors.set_ylabel('RMS error')
        errors.legend(ncols=min(4, state.size))
        low, high = np.array([point.anees_bounds for point in points]).T
        consistency.fill_between(x, low, high, color=BOUND, alpha=0.35, lw=0)
        anees = np.array([point.anees for point in points])
        consistency.plot(x, anees, '.-', color=ESTIMATE, lw=1.0)
        if (anees > 5.0).any():
            consistency.set_yscale('log')
        consistency.set_ylabel('squared error / claimed\n(ANEES)')
        lost.plot(x, [100.0 * point.lost for point in points], '.-', color=TRUTH, lw=1.0)
        lost.set_ylim(-3.0, 103.0)
        lost.set_ylabel('lost [%]')
        lost.set_xlabel(swept.label)
        if swept.log:
            lost.set_xscale('log')
            lost.xaxis.set_major_formatter(FormatStrFormatter('%g'))


def _theory(axis: Any, x: Sequence[float], expected: Sequence[float]) -> None:
    if not np.isfinite(expected).any():
        return
    axis.plot(x, expected, '--', color=TRUTH, lw=0.9, label='theory')
    if np.nanmax(expected) > 20.0 * np.nanmin(expected):
        axis.set_yscale('log')
        log_ticks(axis)


def _maps(
    ranges: Sequence[Range],
    state: Space,
    points: Sequence[Point],
    marks: Sequence[float | None],
    path: Path,
) -> None:
    down, across = ranges
    shape = len(down.values), len(across.values)

    def grid(values: Sequence[float]) -> Array:
        return np.array(values, dtype=float).reshape(shape)

    panels = {
        'cost per second': grid([point.cost for point in points]),
        f'RMS error of {state.label(state.names[0])}': grid(
            [point.rms[0] if point.rms else np.nan for point in points]
        ),
        'squared error / claimed (ANEES)': grid([point.anees for point in points]),
        _LOST: grid([100.0 * point.lost for point in points]),
    }
    panels = {title: values for title, values in panels.items() if np.isfinite(values).any()}
    rows = -(-len(panels) // 2)
    shows, marked = 'Averages of the runs at each pair of values.', None not in marks
    if marked:
        shows += ' Cross: the configured ones.'
    with figure_with(path, rows, 2, (9.0, 3.4 * rows + 0.3), shows) as (figure, axes):
        for axis, (title, values) in zip(axes.flat, panels.items()):
            drawn = axis.pcolormesh(
                _edges(across), _edges(down), values, cmap='viridis', norm=_scale(title, values)
            )
            figure.colorbar(drawn, ax=axis)
            axis.set_title(title)
            axis.set_xlabel(across.label)
            axis.set_ylabel(down.label)
            axis.grid(False)
            if marked:
                axis.plot(*([m] for m in reversed(marks)), 'x', color=INPUT, ms=9, mew=2.0)
            if across.log:
                axis.set_xscale('log')
                axis.xaxis.set_major_formatter(FormatStrFormatter('%g'))
            if down.log:
                axis.set_yscale('log')
                axis.yaxis.set_major_formatter(FormatStrFormatter('%g'))
        for axis in axes.flat[len(panels) :]:
            axis.set_axis_off()


def _edges(swept: Range) -> Array:
    """Return the edges (N + 1,) of cells about the values, halfway on the scale of the axis."""
    values = np.log(swept.values) if swept.log else np.array(swept.values, dtype=float)
    half = np.diff(values) / 2.0 if len(values) > 1 else np.array([0.5])
    outer = values[:1] - half[:1], values[-1:] + half[-1:]
    edges = np.concatenate((outer[0], values[:-1] + half[: len(values) - 1], outer[1]))
    return np.exp(edges) if swept.log else edges


def _scale(title: str, values: Array) -> Any:
    """Return the scale of the colours; the share of lost runs is of 100."""
    if title == _LOST:
        return Normalize(0.0, 100.0)
    return 'log' if _spread(values) > 20.0 else 'linear'


def _spread(values: Array) -> float:
    """Return the ratio of the largest to the smallest value; 1 if one is not positive."""
    finite = values[np.isfinite(values)]
    return float(finite.max() / finite.min()) if finite.size and finite.min() > 0.0 else 1.0


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value
