# SPDX-License-Identifier: Apache-2.0
"""Pictures of estimates from arrays, in general without the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.simulation.trajectory import Series

from .mixture_parts import draw_parts, parts_of
from .style import BOUND, ESTIMATE, READING, SIGMAS, TRUTH, legend_below, picture


class Estimates(Protocol):
    """The content of a picture: beliefs over time, and readings by sensor."""

    state: Space
    time: Array
    mean: Array
    std: Array
    readings: Mapping[str, Series]
    outputs: Mapping[str, Space]
    smoothed: bool
    #: With ``slopes``, H (k, n) of each sensor that is linear.
    record: Any


def estimates(result: Any, truth: Array | None, path: Path | None) -> Any:
    """Draw every state with its band, its readings, and the truth (N, n) if it is known.

    The band of a sum of Gaussians is pale beside those of its parts.

    Returns
    -------
    Axes (n, 1).
    """
    space, time = result.state, result.time
    if truth is not None and truth.reshape(len(time), -1).shape != result.mean.shape:
        raise ValueError(f'truth: expected shape {result.mean.shape}, got {truth.shape}')
    parts = parts_of(result)
    with picture(path, space.size, 1, (8.0, 1.6 * space.size + 0.9)) as (figure, axes):
        for index, (name, axis) in enumerate(zip(space.names, axes[:, 0])):
            mean, band = result.mean[:, index], SIGMAS * result.std[:, index]
            _draw_readings(axis, result, name)
            if parts is not None:
                draw_parts(axis, time, parts, index)
            axis.fill_between(
                time, mean - band, mean + band, color=BOUND, lw=0,
                alpha=0.35 if parts is None else 0.15,
                label=f'{SIGMAS:g} sigma',
            )  # fmt: skip
            axis.plot(time, mean, color=ESTIMATE, lw=1.2, label=_label(result))
            if truth is not None:
                column = truth.reshape(len(time), -1)[:, index]
                axis.plot(time, column, color=TRUTH, lw=0.8, label='truth')
            axis.set_ylabel(space.label(name))
        axes[0, 0].set_title('Smoothed estimate' if result.smoothed else 'Filtered estimate')
        legend_below(figure, axes[0, 0])
    return axes


def _label(estimates: Estimates) -> str:
    return 'smoothed' if estimates.smoothed else 'filtered'


def _draw_readings(axis: Any, estimates: Estimates, name: str) -> None:
    """Draw the readings of a state: of its name, or of nothing but a multiple of it."""
    single = estimates.state.size == 1
    labelled = False
    for sensor, series in estimates.readings.items():
        output = estimates.outputs[sensor]
        scales = _scales(estimates, sensor, name)
        named = {i: 1.0 for i, other in enumerate(output.names) if other == name or single}
        for column, scale in list({**named, **scales}.items())[:1]:
            label = None if labelled else 'reading'
            finite = np.isfinite(series.values[:, column])
            axis.plot(
                series.time[finite], series.values[finite, column] / scale, '.', ms=3.0,
                color=READING, label=label,
            )  # fmt: skip
            labelled = True


def _scales(estimates: Estimates, sensor: str, name: str) -> dict[int, float]:
    """Return the readings of a linear sensor that are a multiple of a state, and the multiples."""
    H = estimates.record.slopes.get(sensor)
    if H is None:
        return {}
    index = estimates.state.names.index(name)
    alone = (np.count_nonzero(H, axis=1) == 1) & (H[:, index] != 0.0)
    return {int(row): float(H[row, index]) for row in np.flatnonzero(alone)}
