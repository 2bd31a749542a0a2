# SPDX-License-Identifier: Apache-2.0
"""The table and the picture of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich import box
from rich.table import Table

from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, legend_below, picture

from .comparison import Result

_COLOURS = (INPUT, ESTIMATE, TRUTH, READING)
_COLUMNS = ('error', '95 %', 'ANEES', 'NEES', 'lost', 'us')


def comparison_table(results: Sequence[Result]) -> Table:
    """Return what became of each case.

    The columns are the median and the 95th percentile of the final error, the mean and the
    median of the NEES of a run over its degrees, how many runs lost track, and microseconds for
    a prediction and a correction.
    """
    table = Table(box=box.HORIZONTALS, show_edge=False, padding=(0, 1, 0, 0))
    # on a narrow terminal words are folded, but no digit of a number is cut
    table.add_column('uncertain at first by', overflow='fold')
    table.add_column('filter', overflow='fold')
    for column in _COLUMNS:
        table.add_column(column, justify='right', no_wrap=True)
    case = None
    for result in results:
        if result.case is not case:
            case = result.case
            table.add_section()
            table.add_row(f'[bold]{case.name} \\[{case.unit}][/]')
        found = result.summary()
        table.add_row(
            found['uncertainty'],
            found['filter'],
            f'{found["median_error"]:.3g}',
            f'{found["percentile_95_error"]:.3g}',
            f'{found["anees"]:.3g}',
            f'{found["median_nees"]:.3g}',
            str(found['lost']),
            f'{found["microseconds_per_step"]:.0f}',
        )
    return table


def comparison_picture(results: Sequence[Result], path: Path) -> None:
    """Draw the median and the 95th percentile of the error in time: a case a column."""
    cases = list(dict.fromkeys(result.case.name for result in results))
    filters = list(dict.fromkeys(result.filter for result in results))
    rows = max(len(result.case.widths) for result in results)
    size = (3.6 * len(cases), 2.1 * rows + 0.7)
    with picture(path, rows, len(cases), size) as (figure, axes):
        for result in results:
            widths = list(result.case.widths)
            axis = axes[widths.index(result.width), cases.index(result.case.name)]
            colour = _COLOURS[filters.index(result.filter)]
            for quantile, line, what in ((0.5, '-', 'median'), (0.95, '--', '95 %')):
                errors = np.quantile(result.errors, quantile, axis=0)
                label = f'{result.filter}, {what}'
                axis.semilogy(result.time, errors, line, lw=1.1, color=colour, label=label)
            axis.set_title(f'{result.case.name}: {result.case.widths[result.width]}')
            axis.set_ylabel(f'error [{result.case.unit}]')
        legend_below(figure, axes[0, 0])
