# SPDX-License-Identifier: Apache-2.0
"""Pictures of a fit: likelihood profiles, and the NIS before and after."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator, NullFormatter

from kalman_ros.analysis.tuning.held_out import Judgement, SensorJudgement
from kalman_ros.analysis.tuning.profiles import Profile
from kalman_ros.core import Array
from kalman_ros.report.style import BOUND, ESTIMATE, INPUT, READING, figure_with, picture

#: Drop of the log-likelihood at the ends of a 95 % interval.
_DROP = -1.92
#: Number of pieces of the recording; the mean NIS of each piece is drawn.
_PIECES = 60


def draw_profiles(profiles: Sequence[Profile], path: Path) -> None:
    """Draw the likelihood around each fitted value."""
    columns = min(3, len(profiles))
    rows = -(-len(profiles) // columns)
    shows = 'How much less likely the recording is with another value.'
    with figure_with(path, rows, columns, (3.2 * columns, 2.4 * rows + 0.3), shows) as (_, axes):
        for axis in axes.flat[len(profiles) :]:
            axis.set_axis_off()
        for axis, profile in zip(axes.flat, profiles):
            axis.plot(
                profile.value, profile.expected, color=BOUND, lw=1.0, label='by its interval'
            )
            axis.plot(profile.value, profile.drop, '.-', color=ESTIMATE, label='log-likelihood')
            axis.axhline(_DROP, color=READING, lw=0.8, ls='--', label='95 %')
            axis.set_ylim(-6.0, 0.5)
            axis.set_title(profile.name.removeprefix('model_parameters.'))
            axis.set_xlabel(f'value [{profile.unit}]' if profile.unit else 'value')
            axis.xaxis.set_major_locator(MaxNLocator(4))
            axis.xaxis.set_minor_formatter(NullFormatter())
        axes.flat[0].set_ylabel('log-likelihood, less its maximum')
        axes.flat[0].legend(fontsize=7, loc='lower center')


def draw_nis(before: Judgement, after: Judgement, held_from: float | None, path: Path) -> None:
    """Draw the NIS of each sensor by its degrees of freedom, before and after the fit."""
    names = list(after.sensors)
    shows = 'The squared surprise of each sensor over the expected one, before and after the fit.'
    with picture(path, len(names), 1, (8.0, 2.2 * len(names) + 0.4), shows) as (_, axes):
        for axis, name in zip(axes[:, 0], names):
            if name in before.sensors:
                axis.plot(*_pieces(before.sensors[name]), color=READING, label='before')
            axis.plot(*_pieces(after.sensors[name]), color=ESTIMATE, label='after')
            axis.axhline(1.0, color=INPUT, lw=0.8, label='expected')
            axis.set_yscale('log')
            axis.set_title(f'NIS of {name}')
            if held_from is not None:
                axis.axvline(held_from, color=BOUND, lw=1.0, ls='--', label='held out from here')
        axes[0, 0].legend(ncols=4, fontsize=7)


def _pieces(sensor: SensorJudgement) -> tuple[Array, Array]:
    """Return the times and the mean NIS of the pieces of a recording."""
    count = min(_PIECES, max(1, len(sensor.time) // 5))
    parts = np.array_split(np.arange(len(sensor.time)), count)
    times = np.array([sensor.time[part].mean() for part in parts if len(part)])
    means = np.array([sensor.squares[part].mean() for part in parts if len(part)])
    return times, means
