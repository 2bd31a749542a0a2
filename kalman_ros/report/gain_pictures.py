# SPDX-License-Identifier: Apache-2.0
"""Pictures of the covariance of a run and of the gain of each sensor."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators import filter_class
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .close_up import close_up
from .style import CURVES, envelope, log_ticks, picture, time_unit

#: Number of gains of one sensor over a run, and largest number of curves of a panel.
_GAINS, _CURVES = 400, len(CURVES)
#: Curves whose magnitudes differ by more than this factor are drawn on a logarithmic axis.
_WIDE = 30.0
#: Curves that differ by less, as a share of their largest value, are one in a picture.
_COINCIDE = 0.01
#: Deviations that differ by more than this factor are drawn on a logarithmic axis.
_DECADE = 10.0


def gains(scenario: Scenario, run: Trajectory, path: Path | None) -> Any:
    """Draw the deviation of every state and the gains of every sensor: the run, and its start.

    The start shows how P grows with each prediction and shrinks with each update.

    Returns
    -------
    Axes with two columns: the run, and its start.
    """
    space, start = scenario.model.state, close_up(scenario, run)
    units = list(dict.fromkeys(space.units))
    # the gain of an optimal filter follows from its covariance, for a UKF approximately
    optimal = filter_class(scenario.filter).optimal
    by_sensor = _sensor_gains(scenario, run, start) if optimal else {}
    rows = len(units) + len(by_sensor)
    shows = 'What is believed of each state, and how much each reading counts.'
    with picture(path, rows, 2, (10.0, 1.5 * rows + 0.7), shows) as (_, axes):
        close = _start_deviations(scenario, run, start)
        for row, unit in zip(axes, units):
            row[0].set_ylabel(f'sigma [{unit}]' if unit else 'sigma')
            indices = [index for index, other in enumerate(space.units) if other == unit]
            whole = _std(run.covariance)
            alike = _alike({index: whole[:, index] for index in indices})
            for colour, (index, others) in zip(_colours(len(alike)), alike.items()):
                label = ', '.join(space.names[other] for other in others)
                for axis, (time, std) in zip(row, ((run.time, whole), close)):
                    axis.plot(*envelope(time, std[:, index]), lw=1.0, color=colour, label=label)
            for axis in row:
                _scale(axis)
        for row, (name, gains_) in zip(axes[len(units) :], by_sensor.items()):
            row[0].set_ylabel(f'L of {name}')
            _draw_gains(row, scenario, run, name, gains_)
        for row in axes:
            row[1].legend(loc='center left', bbox_to_anchor=(1.0, 0.5), fontsize=8)
        axes[0, 0].set_title('Deviation of the estimate, and gains')
        axes[0, 1].set_title(f'The first {start:.3g} {time_unit()}: predict and update')
        axes[0, 1].set_xlim(0.0, start)
    return axes


def _scale(axis: Any) -> None:
    """Show deviations from 0, or logarithmically where they differ by a decade or more."""
    shown = np.concatenate([line.get_ydata() for line in axis.get_lines()])
    shown = shown[shown > 0.0]
    if not shown.size or shown.max() < _DECADE * shown.min():
        axis.set_ylim(0.0, 1.1 * shown.max() if shown.size else None)
        return
    axis.set_yscale('log')
    low, high = axis.get_ylim()
    axis.set_ylim(low / 1.4, high * 1.4)  # leaves room for a second tick
    log_ticks(axis)


def _alike(curves: Mapping[int, Array]) -> dict[int, list[int]]:
    """Return the curves that differ, by their first index, each with all that coincide with it."""
    groups: dict[int, list[int]] = {}
    for index, curve in curves.items():
        width = _COINCIDE * float(np.abs(curve).max(initial=0.0))
        same = (of for of in groups if np.abs(curves[of] - curve).max(initial=0.0) <= width)
        groups.setdefault(next(same, index), []).append(index)
    return groups


def _colours(count: int) -> list[str]:
    return [CURVES[k % len(CURVES)] for k in range(count)]


def _std(covariance: Array) -> Array:
    """Return the standard deviations (..., n) of covariances (..., n, n)."""
    return np.asarray(np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0)))


def _start_deviations(scenario: Scenario, run: Trajectory, start: float) -> tuple[Array, Array]:
    """Return times and standard deviations before and after each update of the start.

    The covariance before the update is P = F P F' + Q, predicted from the previous step.
    """
    times, covariances = [run.time[0]], [run.covariance[0]]
    last = min(int(np.searchsorted(run.time, start, side='right')) + 1, len(run.time))
    for k in range(1, last):
        dt = float(run.time[k] - run.time[k - 1])
        step = scenario.model.linearized_step(run.estimate[k - 1], run.input[k - 1], dt)
        times += [run.time[k]] * 2
        covariances += [step.F @ run.covariance[k - 1] @ step.F.T + step.Q, run.covariance[k]]
    return np.array(times), _std(np.array(covariances))


def _sensor_gains(
    scenario: Scenario, run: Trajectory, start: float
) -> dict[str, tuple[Array, Array]]:
    """Return times (N,) and gains (N, n, k) of each sensor: all at the start, then a sample.

    From L S = P- C' and P = P- - L C P- follows L = P C' R^-1 with P after the update.
    """
    by_sensor = {}
    for name, source in scenario.enabled.items():
        time = run.innovations[name].time
        if not len(time):
            continue
        spread = np.linspace(0, len(time) - 1, min(_GAINS, len(time))).astype(int)
        time = time[np.union1d(spread, np.flatnonzero(time <= start))]
        steps = np.minimum(np.searchsorted(run.time, time - 1e-9), len(run.time) - 1)
        L = [
            _gain_from_posterior(
                run.covariance[step], source.sensor.jacobian(run.estimate[step]), R
            )
            for step, R in zip(steps, _noise_at(scenario, run, name, time))
        ]
        by_sensor[name] = time, np.array(L)
    return by_sensor


def _gain_from_posterior(P: Array, C: Array, R: Array) -> Array:
    return np.asarray(np.linalg.lstsq(R, C @ P, rcond=None)[0].T)


def _noise_at(scenario: Scenario, run: Trajectory, name: str, time: Array) -> list[Array]:
    """Return the noise covariances (k, k) of the readings at these times."""
    source, series = scenario.enabled[name], run.readings[name]
    if series.covariance is None:
        return [source.sensor.covariance] * len(time)
    nearest = np.minimum(np.searchsorted(series.time, time - 1e-9), len(series.time) - 1)
    used = (source.used(message_covariance) for message_covariance in series.covariance[nearest])
    return [source.sensor.covariance if R is None else R for R in used]


def _draw_gains(
    row: Any, scenario: Scenario, run: Trajectory, name: str, gains: tuple[Array, Array]
) -> None:
    """Draw the gains of a sensor with the largest effect relative to the deviation of a state."""
    time, L = gains
    space, output = scenario.model.state, scenario.sensors[name].sensor.output
    effect = np.abs(L).mean(axis=0) * run.innovations[name].std.mean(axis=0)
    effect /= np.maximum(_std(run.covariance).mean(axis=0), 1e-300)[:, np.newaxis]
    strongest = np.argsort(-effect, axis=None)[:_CURVES]
    kept = [index for index in strongest if effect.flat[index] > 0.01 * effect.max()]
    flat = L.reshape(len(L), -1)
    alike = _alike({int(index): flat[:, index] for index in sorted(kept)})
    sizes: list[float] = []
    for colour, (first, group) in zip(CURVES, alike.items()):
        pairs = [np.unravel_index(index, effect.shape) for index in group]
        label = ', '.join(f'{space.names[i]} by {output.names[j]}' for i, j in pairs)
        i, j = pairs[0]
        label += _gain_unit(space.units[i], output.units[j])
        for axis, marker in zip(row, ('-', '.-')):
            axis.plot(time, flat[:, first], marker, ms=3.0, lw=0.9, color=colour, label=label)
        sizes.append(float(np.abs(flat[:, first]).mean()))
    if sizes and max(sizes) > _WIDE * min(sizes) > 0.0:
        for axis in row:
            axis.set_yscale('symlog', linthresh=10.0 ** np.floor(np.log10(min(sizes))))


def _gain_unit(state: str, output: str) -> str:
    """Return the unit of a gain, in brackets after a space; '' for a gain without a unit."""
    if state == output:
        return ''
    below = f'/({output})' if '/' in output or ' ' in output else f'/{output}'
    return f' [{state or "1"}{below if output else ""}]'
