# SPDX-License-Identifier: Apache-2.0
"""The style of all pictures: truth is black, estimates are blue, readings are grey."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

TRUTH = '#1a1a1a'
ESTIMATE = '#0b6fb8'
READING = '#9aa3ab'
INPUT = '#b8500b'
BOUND = '#5a9bd0'

_STYLE = {
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


@contextmanager
def caption(text: str) -> Iterator[None]:
    """Write ``text`` above every picture that is drawn meanwhile: what it is a picture of."""
    before = _CAPTION.set(text)
    try:
        yield
    finally:
        _CAPTION.reset(before)


@contextmanager
def picture(
    path: Path | None, rows: int, columns: int, size: tuple[float, float]
) -> Iterator[tuple[Any, Any]]:
    """Yield a figure and its axes (rows, columns), with time across unless labelled; save it."""
    with figure_with(path, rows, columns, size, sharex='col') as (figure, axes):
        yield figure, axes
        for axis in axes[-1]:
            axis.set_xlabel(axis.get_xlabel() or 'time [s]')


@contextmanager
def figure_with(
    path: Path | None, rows: int, columns: int, size: tuple[float, float], **options: Any
) -> Iterator[tuple[Any, Any]]:
    """Yield a figure and its axes (rows, columns); save it to ``path``."""
    with canvas(path, size) as figure:
        yield figure, figure.subplots(rows, columns, squeeze=False, **options)


@contextmanager
def canvas(path: Path | None, size: tuple[float, float]) -> Iterator[Any]:
    """Yield an empty figure; save it to ``path``, or leave it to pyplot to show."""
    with mpl.rc_context(_STYLE):
        if path is not None:
            figure = Figure(figsize=size, layout='constrained')
            if _CAPTION.get():
                figure.suptitle(_CAPTION.get(), fontsize=8, color=TRUTH, x=0.01, ha='left')
            yield figure
            figure.savefig(path)
        else:
            from matplotlib import pyplot  # it detects the display of this machine

            yield pyplot.figure(figsize=size, layout='constrained')


def shades(count: int) -> list[Any]:
    """Return colours of a family of curves, from light to dark."""
    return [mpl.colormaps['Blues'](0.3 + 0.7 * k / max(1, count - 1)) for k in range(count)]


def legend_below(figure: Any, axis: Any, markerscale: float = 3.0) -> None:
    """Put the legend of ``axis`` under the figure, where it covers no data."""
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc='outside lower center', ncols=len(labels), markerscale=markerscale
    )
