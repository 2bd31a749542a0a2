# SPDX-License-Identifier: Apache-2.0
"""Picture of two runs with different parameters and the same seed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .style import ESTIMATE, INPUT, SIGMAS, legend_below, picture, with_gaps

#: Styles of the first run, and of the second run, which is thinner and drawn above it.
_LOOKS = ({'color': ESTIMATE, 'lw': 1.8}, {'color': INPUT, 'lw': 0.7})


def pair(
    scenarios: Sequence[Scenario], runs: Sequence[Trajectory], labels: Sequence[str], path: Path
) -> Any:
    """Draw the states, errors and inputs of two runs.

    Returns
    -------
    Axes with two columns: state and error, or input and its RMS so far.
    """
    state, input = scenarios[0].model.state, scenarios[0].model.input
    rows = state.size + input.size
    with picture(path, rows, 2, (9.5, 1.5 * rows + 0.7)) as (figure, axes):
        for run, label, look in zip(runs, labels, _LOOKS):
            _draw_states(axes, state, run, label, look)
            for row, u in zip(axes[state.size :], run.input.T):
                row[0].step(run.time, u, where='post', **look)
                count = np.arange(1, len(u) + 1)
                row[1].plot(run.time, np.sqrt(np.cumsum(u**2) / count), **look)
        limits = np.max([_error_limits(state, run) for run in runs], axis=0)
        for row, name, limit in zip(axes, state.names, limits):
            row[1].set_ylim(-limit, limit)
            row[0].set_ylabel(state.label(name))
            row[1].set_ylabel(f'error of\n{state.label(name)}')
        for row, name in zip(axes[state.size :], input.names):
            row[0].set_ylabel(input.label(name))
            row[1].set_ylabel(f'RMS so far\n{input.label(name)}')
        axes[0, 0].set_title('The true state, and the input')
        axes[0, 1].set_title(f'The error of the estimate, and {SIGMAS:g} sigma')
        legend_below(figure, axes[0, 0])
    return axes


def _error_limits(state: Space, run: Trajectory) -> Array:
    """Return the limits (n,) of the panels, which contain all errors and most of the band."""
    band = np.quantile(_band(run), 0.9, axis=0)
    error = np.abs(state.subtract(run.truth, run.estimate)).max(axis=0)
    return np.asarray(1.2 * np.maximum(error, band))


def _band(run: Trajectory) -> Array:
    P = run.covariance.diagonal(axis1=1, axis2=2)
    return np.asarray(SIGMAS * np.sqrt(np.maximum(P, 0.0)))


def _draw_states(
    axes: Any, state: Space, run: Trajectory, label: str, look: dict[str, Any]
) -> None:
    truth = with_gaps(run.truth, state)
    error = state.subtract(run.truth, run.estimate)
    band = _band(run)
    for index, row in enumerate(axes[: state.size]):
        row[0].plot(run.time, truth[:, index], label=label, **look)
        row[1].plot(run.time, error[:, index], **look)
        for sign in (-1.0, 1.0):
            row[1].plot(run.time, sign * band[:, index], ls='--', **look)
