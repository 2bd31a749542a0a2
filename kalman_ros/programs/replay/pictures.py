# SPDX-License-Identifier: Apache-2.0
"""Pictures of a replay."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from kalman_ros.analysis.checks import MISS
from kalman_ros.bags.replayed import Replayed
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.report.style import (
    BOUND,
    ESTIMATE,
    INPUT,
    READING,
    SIGMAS,
    TRUTH,
    figure_with,
    legend_below,
    picture,
    with_gaps,
)

from .comparison import Comparison
from .statistics import LAGS, autocorrelation, normalised_innovations, plane, whiteness_bound

#: Largest number of points of a curve; of a longer curve, every k-th point is drawn.
_MOST = 20_000
#: Number of readings in a running mean.
_RUNNING = 50


def draw_all(replayed: Replayed, folder: Path) -> list[Path]:
    """Draw every picture into ``folder`` and return their paths."""
    pictures = {'states.png': states}
    if replayed.sensors:
        pictures['delays.png'] = delays
    if any(np.isfinite(sensor.nis).any() for sensor in replayed.sensors.values()):
        pictures.update({'innovations.png': innovations, 'consistency.png': consistency})
    if plane(replayed.scenario.model.state) is not None:
        pictures['map.png'] = plan_view
    paths = []
    for name, draw in pictures.items():
        paths.append(folder / name)
        draw(replayed, folder / name)
    return paths


def _every_kth(count: int) -> slice:
    return slice(None, None, max(1, ceil(count / _MOST)))


def states(replayed: Replayed, path: Path) -> None:
    """Draw each state with its band, and the readings, the truth and the smoothed state."""
    space, beliefs = replayed.scenario.model.state, replayed.beliefs
    part = _every_kth(len(beliefs.time))
    time, mean, std = beliefs.time[part], beliefs.mean[part], beliefs.std[part]
    truth = None if replayed.truth is None else replayed.truth.at(replayed.scenario, time)
    shows = 'Each state as the estimator believes it, with its band and what was read.'
    with picture(path, space.size, 1, (8.0, 1.5 * space.size + 0.9), shows) as (figure, axes):
        for index, (name, axis) in enumerate(zip(space.names, axes[:, 0])):
            _readings(replayed, name, axis)
            x, band = mean[:, index], SIGMAS * std[:, index]
            label = f'estimate, {SIGMAS:g} sigma'
            axis.fill_between(time, x - band, x + band, color=BOUND, alpha=0.35, lw=0, label=label)
            axis.plot(
                time, with_gaps(mean, space)[:, index], color=ESTIMATE, lw=1.0, label='estimate'
            )
            if replayed.smoothed is not None and len(replayed.smoothed.time):
                s = replayed.smoothed
                some = _every_kth(len(s.time))
                curve = with_gaps(s.mean[some], space)[:, index]
                axis.plot(s.time[some], curve, color=INPUT, lw=0.9, label='smoothed')
            if truth is not None:
                curve = with_gaps(truth, space)[:, index]
                axis.plot(time, curve, color=TRUTH, lw=0.8, label='truth')
            axis.set_ylabel(space.label(name))
        axes[0, 0].set_title('What was estimated')
        fullest = max(axes[:, 0], key=lambda axis: len(axis.get_legend_handles_labels()[1]))
        legend_below(figure, fullest)


def _readings(replayed: Replayed, name: str, axis: Any) -> None:
    """Draw the readings of the sensors that read a state as it is, but not those dropped."""
    label: str | None = 'reading'
    for sensor_name, sensor in replayed.sensors.items():
        outputs = replayed.scenario.sensors[sensor_name].sensor.output.names
        if name in outputs and len(sensor.stamp):
            part, known = _every_kth(len(sensor.stamp)), sensor.outcome != Outcome.NOT_FINITE.name
            values = np.where(known, sensor.value[:, outputs.index(name)], np.nan)[part]
            axis.plot(sensor.stamp[part], values, '.', ms=2.0, color=READING, label=label)
            label = None


def innovations(replayed: Replayed, path: Path) -> None:
    """Draw the innovations of every sensor inside their bounds."""
    rows = [
        (name, column)
        for name, sensor in replayed.sensors.items()
        for column in range(sensor.value.shape[1])
        if np.isfinite(sensor.nis).any()
    ]
    shows = 'What each reading surprised the filter by, inside what it expects.'
    with picture(path, len(rows), 1, (8.0, 1.5 * len(rows) + 0.9), shows) as (figure, axes):
        for axis, (name, column) in zip(axes[:, 0], rows):
            sensor = replayed.sensors[name]
            part = _every_kth(len(sensor.stamp))
            time, v = sensor.stamp[part], sensor.innovation[part, column]
            std = np.sqrt(sensor.innovation_covariance[part, column, column])
            axis.plot(time, v, '.', ms=2.0, color=TRUTH, label='innovation')
            for sign in (-SIGMAS, SIGMAS):
                label = f'{SIGMAS:g} sigma expected' if sign > 0 else None
                axis.plot(time, sign * std, color=ESTIMATE, lw=1.0, label=label)
            output = replayed.scenario.sensors[name].sensor.output
            axis.set_ylabel(f'{name}\n{output.label(output.names[column])}')
        axes[0, 0].set_title('Readings minus their predictions, and how wide they should be')
        legend_below(figure, axes[0, 0])


def consistency(replayed: Replayed, path: Path) -> None:
    """Draw the NIS of each sensor in time, and the autocorrelation of its innovations."""
    names = [name for name, s in replayed.sensors.items() if np.isfinite(s.nis).any()]
    size = (9.5, 1.8 * len(names) + 0.6)
    shows = 'Whether innovations are as large as the filter expects, and independent.'
    with figure_with(path, len(names), 2, size, shows) as (_, axes):
        for (left, right), name in zip(axes, names):
            sensor = replayed.sensors[name]
            use, k = np.isfinite(sensor.nis), sensor.value.shape[1]
            time, nis = sensor.stamp[use], sensor.nis[use] / k
            part = _every_kth(len(time))
            left.plot(time[part], nis[part], '.', ms=2.0, color=READING)
            width = min(_RUNNING, len(nis))
            mean = np.convolve(nis, np.ones(width) / width, 'valid')
            left.plot(time[width - 1 :][part], mean[part], color=ESTIMATE, lw=1.0)
            left.axhline(1.0, color=TRUTH, lw=0.8)
            left.set_ylabel(f'{name}\nNIS / {k}')
            left.set_xlabel('time [s]')
            z = normalised_innovations(sensor)
            lags = min(LAGS, len(z) - 1)
            if lags > 0:
                right.bar(np.arange(1, lags + 1), autocorrelation(z, lags), color=ESTIMATE)
                bound = whiteness_bound(len(z), k, MISS)
                for sign in (-bound, bound):
                    right.axhline(sign, color=TRUTH, lw=0.8, ls='--')
            right.xaxis.set_major_locator(MaxNLocator(integer=True))
            right.set_xlabel('lag [readings]')
        axes[0, 0].set_title(f'NIS, and its mean over {_RUNNING}')
        axes[0, 1].set_title('Autocorrelation of the innovations')


def delays(replayed: Replayed, path: Path) -> None:
    """Draw the delay of each reading from its stamp to its reception."""
    names = list(replayed.sensors)
    shows = 'How long each reading took from its stamp to the recorder.'
    with picture(path, len(names), 1, (8.0, 1.3 * len(names) + 0.9), shows) as (_, axes):
        for axis, name in zip(axes[:, 0], names):
            sensor = replayed.sensors[name]
            part = _every_kth(len(sensor.stamp))
            late = 1e3 * (sensor.received - sensor.stamp)[part]
            axis.plot(sensor.received[part], late, '.', ms=2.0, color=TRUTH)
            axis.set_ylabel(f'{name}\n[ms]')
        axes[0, 0].set_title('Delay from stamp to reception')


def plan_view(replayed: Replayed, path: Path) -> None:
    """Draw the path in the plane."""
    both = plane(replayed.scenario.model.state)
    assert both is not None
    x, y = both
    mean = replayed.beliefs.mean
    part = _every_kth(len(mean))
    with figure_with(path, 1, 1, (6.0, 6.0), 'Where the body was, from above.') as (figure, axes):
        axis = axes[0, 0]
        if replayed.truth is not None:
            truth = replayed.truth.state[_every_kth(len(replayed.truth.state))]
            axis.plot(truth[:, x], truth[:, y], color=TRUTH, lw=0.8, label='truth')
        axis.plot(mean[part, x], mean[part, y], color=ESTIMATE, lw=1.0, label='estimate')
        if replayed.smoothed is not None:
            smoothed = replayed.smoothed.mean
            some = _every_kth(len(smoothed))
            axis.plot(smoothed[some, x], smoothed[some, y], color=INPUT, lw=0.9, label='smoothed')
        axis.set_aspect('equal', 'datalim')
        axis.set_xlabel('x [m]')
        axis.set_ylabel('y [m]')
        axis.set_title('The path')
        legend_below(figure, axis)


def against(replayed: Replayed, pair: Comparison, path: Path) -> None:
    """Draw two estimates in the plane, and their distance in time."""
    ours, other, truth = replayed.poses(), pair.other, replayed.reference()
    apart = pair.apart
    assert ours is not None and apart is not None
    shown = ours.within(other)
    there = other.at(shown.time)
    if apart.aligned:
        shown = shown.aligned_with(there)
    shows = f'Where the estimate and {pair.topic} were, and how far apart.'
    with figure_with(path, 1, 2, (11.0, 5.2), shows) as (figure, axes):
        left, right = axes[0]
        for poses, color, label in (
            (truth, TRUTH, 'truth'), (other, READING, pair.topic), (shown, ESTIMATE, 'estimate'),
        ):  # fmt: skip
            if poses is not None and len(poses.time):
                some = _every_kth(len(poses.time))
                place = poses.position[some]
                left.plot(place[:, 0], place[:, 1], color=color, lw=1.0, label=label)
        left.set_aspect('equal', 'datalim')
        left.set_xlabel('x [m]')
        left.set_ylabel('y [m]')
        left.set_title('The path')
        some = _every_kth(len(apart.time))
        right.plot(apart.time[some], apart.distance[some], color=ESTIMATE, lw=1.0)
        if shown.covariance is not None:
            spread = SIGMAS * np.sqrt(np.trace(shown.covariance, axis1=1, axis2=2))
            right.fill_between(
                shown.time[some], 0.0, spread[some], color=BOUND, alpha=0.35, lw=0,
                label=f'{SIGMAS:g} sigma of the estimate',
            )  # fmt: skip
        right.set_xlabel('time [s]')
        right.set_ylabel('distance [m]')
        right.set_title(f'From {pair.topic}')
        legend_below(figure, left, right)
