# SPDX-License-Identifier: Apache-2.0
"""Pictures of estimates from arrays, usually without the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.simulation.trajectory import Series

from .run_pictures import SIGMAS
from .style import BOUND, ESTIMATE, READING, TRUTH, legend_below, picture


class Estimates(Protocol):
    """The content of a picture: beliefs over time, and readings."""

    state: Space
    time: Array
    mean: Array
    std: Array
    readings: Mapping[str, Series]
    outputs: Mapping[str, Space]
    smoothed: bool


def estimates(found: Any, truth: Array | None, path: Path | None) -> Any:
    """Draw every state with its band, its readings, and the truth (N, n) if known.

    Returns
    -------
    The axes (n, 1).
    """
    space, time = found.state, found.time
    if truth is not None and truth.reshape(len(time), -1).shape != found.mean.shape:
        raise ValueError(f'truth: expected shape {found.mean.shape}, got {truth.shape}')
    with picture(path, space.size, 1, (8.0, 1.6 * space.size + 0.9)) as (figure, axes):
        for index, (name, axis) in enumerate(zip(space.names, axes[:, 0])):
            mean, band = found.mean[:, index], SIGMAS * found.std[:, index]
            _readings(axis, found, name)
            axis.fill_between(
                time, mean - band, mean + band, color=BOUND, alpha=0.35, lw=0,
                label=f'{SIGMAS:g} sigma',
            )  # fmt: skip
            axis.plot(time, mean, color=ESTIMATE, lw=1.2, label=_kind(found))
            if truth is not None:
                column = truth.reshape(len(time), -1)[:, index]
                axis.plot(time, column, color=TRUTH, lw=0.8, label='truth')
            axis.set_ylabel(space.label(name))
        axes[0, 0].set_title('Smoothed estimate' if found.smoothed else 'Filtered estimate')
        legend_below(figure, axes[0, 0])
    return axes


def _kind(found: Estimates) -> str:
    return 'smoothed' if found.smoothed else 'filtered'


def _readings(axis: Any, found: Estimates, name: str) -> None:
    """Draw the readings of a directly measured state: outputs of its name, or a lone number."""
    single = found.state.size == 1
    shown = False
    for sensor, series in found.readings.items():
        output = found.outputs[sensor]
        columns = [i for i, own in enumerate(output.names) if own == name or single]
        for column in columns[:1]:
            label = None if shown else 'reading'
            there = np.isfinite(series.values[:, column])
            axis.plot(
                series.time[there], series.values[there, column], '.', ms=3.0, color=READING,
                label=label,
            )  # fmt: skip
            shown = True
