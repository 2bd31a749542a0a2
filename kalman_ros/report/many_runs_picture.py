# SPDX-License-Identifier: Apache-2.0
"""Picture of a Monte Carlo experiment: errors and consistency over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.estimators.consistency import chi_square_bounds

from .style import BOUND, ESTIMATE, TRUTH, legend_below, picture

#: Probability of an ANEES outside its band.
_MISS = 0.05


def many_runs(ensemble: Any, path: Path | None) -> Any:
    """Draw the RMS error and the claimed deviation of each state, and the ANEES, over time.

    Returns
    -------
    Axes (n + 1, 1).
    """
    space, time = ensemble.scenario.model.state, ensemble.time
    rows = space.size + 1
    with picture(path, rows, 1, (8.0, 1.5 * rows + 0.9)) as (figure, axes):
        for index, (name, axis) in enumerate(zip(space.names, axes[:-1, 0])):
            axis.plot(time, ensemble.step_rms[:, index], color=TRUTH, lw=1.0, label='RMS error')
            claimed = ensemble.step_std[:, index]
            axis.plot(time, claimed, color=ESTIMATE, lw=1.2, label='claimed deviation')
            axis.set_ylabel(space.label(name))
            axis.set_ylim(bottom=0.0)
        last = axes[-1, 0]
        low, high = np.array(
            [_band(int(count), space.size) for count in ensemble.outcomes.count]
        ).T
        last.fill_between(time, low, high, color=BOUND, alpha=0.35, lw=0, label='95 %')
        last.plot(time, ensemble.step_anees, color=TRUTH, lw=1.0, label='ANEES')
        last.set_ylabel('ANEES')
        if ensemble.step_anees.max() > 20.0 * max(1.0, np.median(ensemble.step_anees)):
            last.set_yscale('log')
        axes[0, 0].set_title(f'{ensemble.runs} runs of {type(ensemble.scenario.model).__name__}')
        for axis in axes[:, 0]:
            if ensemble.after:
                axis.axvline(ensemble.after, color=BOUND, lw=0.8, ls=':')
        legend_below(figure, axes[0, 0])
        last.legend(loc='upper right', ncols=2)
    return axes


def _band(runs: int, n: int) -> tuple[float, float]:
    """Return the 95 % band of the ANEES of independent runs at one step."""
    return chi_square_bounds(1.0, 2.0 / (n * max(1, runs)), _MISS)
