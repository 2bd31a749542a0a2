# SPDX-License-Identifier: Apache-2.0
"""The Allan deviation over the averaging time, with the noise that was fitted to it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kalman_ros.analysis.allan import Allan
from kalman_ros.report.style import BOUND, ESTIMATE, INPUT, figure_with, legend_below

from .channels import NAMES, UNITS

_LINES = (('white noise', ':'), ('bias instability', '--'), ('bias random walk', '-.'))


def allan_picture(results: Sequence[Allan], path: Path) -> None:
    """Draw six channels, gyro above and accelerometer below."""
    shows = 'How much averages over a time differ from one to the next, and by which noise.'
    sharing = {'sharex': True, 'sharey': 'row'}
    with figure_with(path, 2, 3, (10.0, 6.0), shows, **sharing) as (figure, axes):
        for axis, name, unit, result in zip(axes.ravel(), NAMES, UNITS, results):
            axis.fill_between(result.time, result.low, result.high, color=BOUND, alpha=0.3, lw=0.0,
                              label='95 % interval')  # fmt: skip
            axis.loglog(result.time, result.deviation, color=ESTIMATE, lw=1.4, label='measured')
            lowest = 0.3 * result.deviation.min()
            for (label, line), term in zip(_LINES, np.sqrt(result.terms.T)):
                shown = np.where(term > lowest, term, np.nan)
                axis.loglog(result.time, shown, line, color=INPUT, lw=1.0, label=label)
            axis.set_title(f'{name} [{unit}]')
        axes[1, 1].set_xlabel('averaging time [s]')
        for row in axes:
            row[0].set_ylabel('Allan deviation')
        legend_below(figure, axes[0, 0], markerscale=1.0)
