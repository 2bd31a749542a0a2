# SPDX-License-Identifier: Apache-2.0
"""Pictures of a run of the loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import ceil, inf
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.analysis.verdict import nees_check
from kalman_ros.control.limiter import Limits
from kalman_ros.core import Array, Space
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .close_up import close_up
from .gain_pictures import gains
from .innovation_pictures import innovations
from .maps import plane, route
from .style import (
    BOUND,
    ESTIMATE,
    INPUT,
    READING,
    SIGMAS,
    TRUTH,
    envelope,
    legend_below,
    picture,
    time_unit,
    with_gaps,
)

#: Largest number of readings of a state in the overview.
MOST_READINGS = 200

#: Share of a Gaussian beyond these deviations.
_OUTSIDE = 0.0027


def draw_all(
    scenario: Scenario,
    run: Trajectory,
    folder: Path,
    limits: Limits | None = None,
    followed: Array | None = None,
    begun: Callable[[str], None] = lambda name: None,
) -> list[Path]:
    """Draw every picture of a run into ``folder`` and return their paths.

    ``limits`` are the limits of the actuators, if they are known, ``followed`` the positions
    (k, 2) of a path that the controller was given. ``begun`` gets the name of each picture before
    it is drawn.
    """
    pictures = {
        'overview.png': overview,
        'states.png': states,
        'errors.png': errors,
        'gains.png': gains,
        'innovations.png': innovations,
    }
    if scenario.model.input.size:
        pictures['force.png'] = partial(force, limits=limits)
    if plane(scenario.model.state) is not None:
        pictures['map.png'] = partial(route, followed=followed)
    paths = []
    for name, draw in pictures.items():
        path = folder / name
        begun(name)
        draw(scenario, run, path)
        paths.append(path)
    return paths


def _read_states(scenario: Scenario, run: Trajectory) -> dict[str, tuple[Array, Array]]:
    """Return the times and values of the readings of each directly measured state."""
    space, readings = scenario.model.state, {}
    for name, source in scenario.enabled.items():
        series = run.readings[name]
        for column, output in enumerate(source.sensor.output.names):
            if output in space.names and len(series.time):
                values = series.values[:, column]
                if output in space.angles:
                    truth = np.unwrap(run.truth[:, space.names.index(output)])
                    values = _unwrap_near(values, np.interp(series.time, run.time, truth))
                readings[output] = (series.time, values)
    return readings


def _unwrap_near(angle: Array, reference: Array) -> Array:
    """Return angles (N,) with full turns added, each within pi of its reference (N,)."""
    return reference + (angle - reference + np.pi) % (2.0 * np.pi) - np.pi


def overview(
    scenario: Scenario, run: Trajectory, path: Path | None, *, inputs: bool = False
) -> Any:
    """Draw truth, readings and estimate with its band in a compact figure, two states per row.

    With ``inputs`` the inputs follow the states.
    """
    space, readings = scenario.model.state, _read_states(scenario, run)
    pushed = scenario.model.input if inputs else Space((), ())
    count = space.size + pushed.size
    columns = min(2, count)
    rows = ceil(count / columns)
    shows = f'Each state: the estimate with its band of {SIGMAS:g} sigma, on the truth.'
    with picture(path, rows, columns, (6.8, 1.2 * rows + 0.9), shows) as (figure, axes):
        if count % columns:
            _widen_last(figure, axes)
        for index, axis in zip(range(pushed.size), axes.flat[space.size :]):
            axis.step(run.time, run.input[:, index], where='post', color=INPUT, lw=0.8)
            axis.set_ylabel(pushed.label(pushed.names[index]))
        for index, (name, axis) in enumerate(zip(space.names, axes.flat)):
            shown = readings.get(name)
            if shown is not None:  # at most as many readings as can be distinguished
                step = ceil(len(shown[0]) / MOST_READINGS)
                shown = shown[0][::step], shown[1][::step]
            low, high = _draw_state(axis, run, index, shown, space)
            axis.set_ylabel(space.label(name))
            axis.set_ylim(low, high)
        # the legend is that of a panel with readings, if there is one
        first = next(
            (axes.flat[i] for i, name in enumerate(space.names) if name in readings), None
        )
        legend_below(figure, axes[0, 0] if first is None else first)
    if path is not None:
        # pages show many overviews: this makes a file three times smaller, without visible loss
        with Image.open(path) as image:
            colours = image.convert('RGB').quantize(64, method=Image.Quantize.MAXCOVERAGE)
            colours.save(path, optimize=True)
    return axes


def _widen_last(figure: Any, axes: Any) -> None:
    """Widen the first axis of the last row to the whole row; label the times above it, too."""
    grid = axes[-1, 0].get_gridspec()
    for axis in axes[-1]:
        axis.remove()
    axes[-1, :] = figure.add_subplot(grid[-1, :], sharex=axes[0, 0])
    for axis in axes[-2]:
        axis.tick_params(labelbottom=True)


def _draw_state(
    axis: Any,
    run: Trajectory,
    index: int,
    read: tuple[Array, Array] | None,
    space: Space,
    until: float = np.inf,
) -> tuple[float, float]:
    """Draw truth, readings and estimate with its band of one state, and return the limits.

    An angle is drawn unwrapped, and a rotation with a gap at each jump. Times after ``until`` are
    omitted.
    """
    part = run.time <= until
    time = run.time[part]
    mean, truth = (with_gaps(x, space)[part, index] for x in (run.estimate, run.truth))
    if space.names[index] in space.angles:
        truth = np.unwrap(run.truth[:, index])[part]
        mean = _unwrap_near(run.estimate[part, index], truth)
    band = SIGMAS * np.sqrt(run.covariance[part, index, index])
    if read is not None:
        read = read[0][read[0] <= until], read[1][read[0] <= until]
        axis.plot(
            *read,
            '.',
            ms=2.0 if until == np.inf else 4.0,
            color=READING,
            alpha=0.6,
            label='reading',
        )
    axis.fill_between(
        time, mean - band, mean + band, color=BOUND, alpha=0.35, lw=0,
        label=f'estimate, {SIGMAS:g} sigma',
    )  # fmt: skip
    # the estimate lies on the truth, which is wider: both are seen where they agree
    axis.plot(time, truth, color=TRUTH, lw=2.0, label='truth')
    axis.plot(time, mean, color=ESTIMATE, lw=0.9, label='estimate')
    return _panel_limits(truth, mean, band, read)


def states(scenario: Scenario, run: Trajectory, path: Path | None) -> Any:
    """Draw truth, readings and estimate with its band of every state: the run, and its start."""
    space = scenario.model.state
    readings = _read_states(scenario, run)
    start = close_up(scenario, run)
    shows = 'Each state in the whole run, and on the right at its start.'
    with picture(path, space.size, 2, (9.5, 1.6 * space.size + 0.8), shows) as (figure, axes):
        for index, name in enumerate(space.names):
            for axis, until in zip(axes[index], (np.inf, start)):
                limits = _draw_state(axis, run, index, readings.get(name), space, until)
                axis.set_ylim(*limits)
            axes[index, 0].set_ylabel(space.label(name))
        axes[0, 0].set_title('Truth, readings and estimate')
        axes[0, 1].set_title(f'The first {start:.3g} {time_unit()}: predict and update')
        axes[0, 1].set_xlim(0.0, start)
        legend_below(figure, axes[0, 0])
    return axes


def _panel_limits(
    truth: Array, mean: Array, band: Array, read: tuple[Array, Array] | None
) -> tuple[float, float]:
    """Return limits that contain the truth, the estimate, and nearly all of readings and band.

    The widest tenth of the band is ignored, since at the start it may be hundreds of times wider.
    """
    drawn = np.isfinite(mean) & np.isfinite(truth)
    if not drawn.any():
        return -1.0, 1.0
    truth, mean, band = truth[drawn], mean[drawn], band[drawn]
    edges = [truth.min(), np.quantile(mean, 0.01), np.quantile(mean - band, 0.1)]
    tops = [truth.max(), np.quantile(mean, 0.99), np.quantile(mean + band, 0.9)]
    if read is not None and len(read[1]):
        few, most = np.quantile(read[1], (0.001, 0.999))
        edges.append(few)
        tops.append(most)
    low, high = float(min(edges)), float(max(tops))
    margin = 0.08 * (high - low) or 1.0
    return low - margin, high + margin


def errors(scenario: Scenario, run: Trajectory, path: Path | None) -> Any:
    """Draw the estimation error of every state inside its band."""
    space = scenario.model.state
    error = space.subtract(run.truth, run.estimate)
    std = np.sqrt(run.covariance.diagonal(axis1=1, axis2=2))
    least = _least_std(scenario, run)
    shows = f'An honest filter has {100 * _OUTSIDE:.2f} % of its errors outside of the blue lines.'
    start = close_up(scenario, run)
    with picture(path, space.size, 2, (10.0, 1.5 * space.size + 0.8), shows) as (figure, axes):
        for index, name in enumerate(space.names):
            bound = None if least is None else least[:, index]
            for axis, until in zip(axes[index], (inf, start)):
                shown = slice(int(np.searchsorted(run.time, until, side='right')))
                _draw_error(axis, run.time, error[:, index], std[:, index], bound, shown)
            outside = float(np.mean(np.abs(error[:, index]) > SIGMAS * std[:, index]))
            axes[index, 0].set_title(
                f'{100 * outside:.2f}% outside', loc='right', fontweight='normal'
            )
            axes[index, 0].set_ylabel(f'error of\n{space.label(name)}')
        axes[0, 0].set_title('The error, and the band of the filter')
        axes[0, 1].set_title(f'The first {start:.3g} {time_unit()}')
        legend_below(figure, axes[0, 0])
    return axes


def _draw_error(
    axis: Any, time: Array, error: Array, std: Array, least: Array | None, shown: slice
) -> None:
    """Draw an error (N,) with its bands, of the rows that are shown."""
    time, error, std = time[shown], error[shown], std[shown]
    if least is not None:
        axis.fill_between(
            time, -SIGMAS * least[shown], SIGMAS * least[shown], color=BOUND, alpha=0.35, lw=0,
            label=f'{SIGMAS:g} sigma at best (Cramér-Rao)',
        )  # fmt: skip
    axis.plot(time, error, color=TRUTH, lw=0.8, label='truth - estimate')
    times, deviation = envelope(time, std)
    for sign in (-SIGMAS, SIGMAS):
        axis.plot(
            times, sign * deviation, color=ESTIMATE, lw=1.0,
            label=f'{SIGMAS:g} sigma of the filter' if sign > 0 else None,
        )  # fmt: skip
    # the band of the first moments, before any reading, would hide the rest
    band = SIGMAS * float(np.quantile(std, 0.9))
    limit = 1.2 * max(band, float(np.abs(error).max()))
    axis.set_ylim(-limit, limit)


def _least_std(scenario: Scenario, run: Trajectory) -> Array | None:
    """Return the lower bound of the standard deviations (N, n) of any estimator on this path.

    Return None for a linear scenario, whose filter attains the bound, and if steps are missing.
    The bound omits the expectation over paths, so a filter may be better on one path. The result
    is limited to the deviations of the filter if the filter is consistent.
    """
    dt = scenario.plan.dt
    if scenario.plan.linear or not np.allclose(np.diff(run.time), dt, atol=0.1 * dt):
        return None
    try:
        bound = posterior_cramer_rao(scenario, run.truth, run.input, run.readings, run.time)
    except np.linalg.LinAlgError:
        return None
    least = np.sqrt(bound.diagonal(axis1=1, axis2=2))
    if not nees_check(scenario, run).passed:
        return least
    return np.minimum(least, np.sqrt(run.covariance.diagonal(axis1=1, axis2=2)))


def force(
    scenario: Scenario, run: Trajectory, path: Path | None, limits: Limits | None = None
) -> Any:
    """Draw the input of the controller, and the limits of the actuators."""
    space = scenario.model.input
    shows = 'What the controller asked of the actuators, for each estimate.'
    with picture(path, space.size, 1, (8.0, 1.5 * space.size + 0.6), shows) as (_, axes):
        for index, (name, unit) in enumerate(zip(space.names, space.units)):
            axis = axes[index, 0]
            axis.step(run.time, run.input[:, index], where='post', color=INPUT, lw=0.8)
            axis.set_ylabel(space.label(name))
            sides = () if limits is None else (limits.lower[index], limits.upper[index])
            known = [side for side in sides if np.isfinite(side)]
            for side in known:
                axis.axhline(side, color=TRUTH, lw=1.0, ls='--')
            if known:
                both = ' and '.join(f'{side:g}' for side in known)
                words = f'limit{"s" if len(known) > 1 else ""} {both} {unit}'
                axis.set_title(words, loc='right', fontweight='normal')
        axes[0, 0].set_title('The input for each estimate')
    return axes
