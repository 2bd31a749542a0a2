# SPDX-License-Identifier: Apache-2.0
"""Style of all pictures: the truth is black, estimates are blue, readings are grey."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import (
    FormatStrFormatter,
    LogFormatterSciNotation,
    LogLocator,
    NullFormatter,
)

from kalman_ros.analysis.checks import Check
from kalman_ros.core import Array, Space

TRUTH = '#1a1a1a'
ESTIMATE = '#0b6fb8'
READING = '#9aa3ab'
INPUT = '#b8500b'
BOUND = '#5a9bd0'
#: Colours of other curves, distinct without colour vision (M. Okabe and K. Ito, 2008).
CURVES = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')

#: Half the width of bands, in standard deviations.
SIGMAS = 3.0
#: Ratio of the ends of a logarithmic axis below which it has plain numbers.
_SHORT = 100.0
#: Settings of matplotlib.
STYLE = {
    'figure.dpi': 110,
    'font.size': 9,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': True,
    'grid.color': '#e6e8ea',
    'axes.titlesize': 10,
    'axes.titleweight': 'bold',
    'axes.titlelocation': 'left',
    'legend.frameon': False,
    'savefig.bbox': 'tight',
}


_CAPTION: ContextVar[str] = ContextVar('caption', default='')
_TIME: ContextVar[str] = ContextVar('time', default='s')


@contextmanager
def caption(text: str, time: str = 's') -> Iterator[None]:
    """Write ``text`` above every picture drawn in this context, with ``time`` as unit of time."""
    tokens = _CAPTION.set(text), _TIME.set(time)
    try:
        yield
    finally:
        _CAPTION.reset(tokens[0])
        _TIME.reset(tokens[1])


def with_gaps(curves: Array, space: Space) -> Array:
    """Return curves (N, n) with a gap at each wrap of an angle."""
    return np.where(space.jumps(curves), np.nan, curves)


def time_unit() -> str:
    """Return the unit of time of the pictures that are drawn in this context."""
    return _TIME.get()


def time_label() -> str:
    """Return the label of a time axis."""
    return f'time [{_TIME.get()}]'


@contextmanager
def picture(
    path: Path | None, rows: int, columns: int, size: tuple[float, float], shows: str = ''
) -> Iterator[tuple[Any, Any]]:
    """Yield a figure and axes (rows, columns) over time, label the time axis, save the figure."""
    with figure_with(path, rows, columns, size, shows, sharex='col') as (figure, axes):
        yield figure, axes
        for axis in axes[-1]:
            axis.set_xlabel(axis.get_xlabel() or time_label())


@contextmanager
def figure_with(
    path: Path | None,
    rows: int,
    columns: int,
    size: tuple[float, float],
    shows: str = '',
    **options: Any,
) -> Iterator[tuple[Any, Any]]:
    """Yield a figure and its axes (rows, columns); save it to ``path``."""
    with canvas(path, size, shows) as figure:
        yield figure, figure.subplots(rows, columns, squeeze=False, **options)


@contextmanager
def canvas(path: Path | None, size: tuple[float, float], shows: str = '') -> Iterator[Any]:
    """Yield an empty figure; save it to ``path``, or leave it to pyplot if ``path`` is None.

    Below the caption stands what the picture ``shows``, in one sentence.
    """
    with mpl.rc_context(STYLE):
        if path is not None:
            figure = Figure(figsize=size, layout='constrained')
            lines = [line for line in (_CAPTION.get(), shows) if line]
            if lines:
                figure.suptitle('\n'.join(lines), fontsize=9.5, color=TRUTH, x=0.01, ha='left')
            yield figure
            _plain_numbers(figure)
            figure.savefig(path)
        else:
            from matplotlib import pyplot  # the import detects the display

            yield pyplot.figure(figsize=size, layout='constrained')


def _plain_numbers(figure: Figure) -> None:
    """Label short logarithmic axes with plain numbers; powers of ten have no room for others."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            if not isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
                continue
            axis.set_minor_formatter(NullFormatter())
            if 0.0 < low < high < _SHORT * low:
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axis.set_major_formatter(FormatStrFormatter('%g'))


def allowed(axes: Any, at: Iterable[float], checks: Iterable[Check], colour: str) -> None:
    """Draw the bounds of checks as bars behind their measured numbers, at places ``at``."""
    bounds = [(place, check.low, check.high) for place, check in zip(at, checks)]
    axes.vlines(*zip(*bounds), color=colour, alpha=0.35, lw=5.0, label='_allowed')


def envelope(time: Array, values: Array, count: int = 300) -> tuple[Array, Array]:
    """Return the largest value of each of ``count`` spans of time, as one step curve.

    A sawtooth whose teeth are narrower than a line of the picture would fill a panel. Curves with
    fewer points are returned as they are.
    """
    width = len(time) // count
    if width < 2:
        return time, values
    rows = len(time) // width * width
    return time[:rows:width], values[:rows].reshape(-1, width).max(axis=1)


def log_ticks(axis: Any) -> None:
    """Label a logarithmic y axis with plain numbers at 1, 2 and 5 of each decade."""
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(FormatStrFormatter('%g'))
    axis.yaxis.set_minor_formatter(NullFormatter())


def shades(count: int) -> list[Any]:
    """Return the colours of a family of curves, from light to dark."""
    return [mpl.colormaps['Blues'](0.3 + 0.7 * k / max(1, count - 1)) for k in range(count)]


def legend_below(figure: Any, *axes: Any, markerscale: float = 3.0) -> None:
    """Put the legend of ``axes`` under the figure, where it covers no data."""
    pairs = (zip(*axis.get_legend_handles_labels()) for axis in axes)
    handles, labels = zip(*(pair for axis_pairs in pairs for pair in axis_pairs))
    figure.legend(
        handles, labels, loc='outside lower center', ncols=len(labels), markerscale=markerscale
    )
