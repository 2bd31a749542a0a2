# SPDX-License-Identifier: Apache-2.0
"""The covariance of a run and the gain of each sensor, from the first reading on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators import filter_class
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .close_up import close_up
from .style import CURVES, log_ticks, picture, time_unit

#: The number of gains of one sensor over a run, and the most curves of a panel.
_GAINS, _CURVES = 400, len(CURVES)
#: Curves whose sizes differ by more than this factor are drawn on a logarithmic axis.
_WIDE = 30.0


def gains(scenario: Scenario, run: Trajectory, path: Path | None) -> Any:
    """Draw the deviation of every state, and the gains of every sensor: the run, and its start.

    The start shows how P grows with each prediction and shrinks with each update.

    Returns
    -------
    The axes, two in each row: the run, and its start.
    """
    space, start = scenario.model.state, close_up(scenario, run)
    units = list(dict.fromkeys(space.units))
    # the gain of an optimal filter follows from its covariance: of a UKF nearly
    optimal = filter_class(scenario.filter).optimal
    found = _gains(scenario, run, start) if optimal else {}
    rows = len(units) + len(found)
    with picture(path, rows, 2, (10.0, 1.5 * rows + 0.5)) as (_, axes):
        closely = _sawtooth(scenario, run, start)
        for row, unit in zip(axes, units):
            row[0].set_ylabel(f'sigma [{unit}]' if unit else 'sigma')
            indices = [index for index, own in enumerate(space.units) if own == unit]
            for colour, index in zip(_colours(len(indices)), indices):
                for axis, (time, std) in zip(row, ((run.time, _std(run.covariance)), closely)):
                    axis.semilogy(time, std[:, index], lw=1.0, color=colour,
                                  label=space.names[index])  # fmt: skip
            for axis in row:
                low, high = axis.get_ylim()
                axis.set_ylim(low / 1.4, high * 1.4)  # room for a second tick
                log_ticks(axis)
        for row, (name, gains_) in zip(axes[len(units) :], found.items()):
            row[0].set_ylabel(f'K of {name}')
            _curves(row, scenario, run, name, gains_)
        for row in axes:
            row[1].legend(loc='center left', bbox_to_anchor=(1.0, 0.5), fontsize=8)
        axes[0, 0].set_title('Deviation of the estimate, and gains')
        axes[0, 1].set_title(f'The first {start:.3g} {time_unit()}: predict and update')
        axes[0, 1].set_xlim(0.0, start)
    return axes


def _colours(count: int) -> list[str]:
    return [CURVES[k % len(CURVES)] for k in range(count)]


def _std(covariance: Array) -> Array:
    """Return the deviations (..., n) of covariances (..., n, n)."""
    return np.asarray(np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0)))


def _sawtooth(scenario: Scenario, run: Trajectory, start: float) -> tuple[Array, Array]:
    """Return times and deviations of the start, before and after the update of each step.

    Before it is P = F P F' + Q, predicted from the step before.
    """
    times, found = [run.time[0]], [run.covariance[0]]
    last = min(int(np.searchsorted(run.time, start, side='right')) + 1, len(run.time))
    for k in range(1, last):
        dt = float(run.time[k] - run.time[k - 1])
        step = scenario.model.linearized_step(run.estimate[k - 1], run.input[k - 1], dt)
        times += [run.time[k]] * 2
        found += [step.F @ run.covariance[k - 1] @ step.F.T + step.Q, run.covariance[k]]
    return np.array(times), _std(np.array(found))


def _gains(scenario: Scenario, run: Trajectory, start: float) -> dict[str, tuple[Array, Array]]:
    """Return times (N,) and gains (N, n, k) of each sensor: all of the start, some of the run.

    K = P C' R^-1 with the P after the update, as K S = P- C' and P = P- - K C P- give.
    """
    found = {}
    for name, source in scenario.enabled.items():
        time = run.innovations[name].time
        if not len(time):
            continue
        some = np.linspace(0, len(time) - 1, min(_GAINS, len(time))).astype(int)
        time = time[np.union1d(some, np.flatnonzero(time <= start))]
        steps = np.minimum(np.searchsorted(run.time, time - 1e-9), len(run.time) - 1)
        K = [
            _gain(run.covariance[step], source.sensor.jacobian(run.estimate[step]), R)
            for step, R in zip(steps, _noise(scenario, run, name, time))
        ]
        found[name] = time, np.array(K)
    return found


def _gain(P: Array, C: Array, R: Array) -> Array:
    return np.asarray(np.linalg.lstsq(R, C @ P, rcond=None)[0].T)


def _noise(scenario: Scenario, run: Trajectory, name: str, time: Array) -> list[Array]:
    """Return the noise covariance (k, k) of the readings at some times."""
    source, series = scenario.enabled[name], run.readings[name]
    if series.covariance is None:
        return [source.sensor.covariance] * len(time)
    nearest = np.minimum(np.searchsorted(series.time, time - 1e-9), len(series.time) - 1)
    used = (source.used(carried) for carried in series.covariance[nearest])
    return [source.sensor.covariance if R is None else R for R in used]


def _curves(
    row: Any, scenario: Scenario, run: Trajectory, name: str, found: tuple[Array, Array]
) -> None:
    """Draw the gains of a sensor that move its states most, in deviations of each."""
    time, K = found
    space, output = scenario.model.state, scenario.sensors[name].sensor.output
    moved = np.abs(K).mean(axis=0) * run.innovations[name].std.mean(axis=0)
    moved /= np.maximum(_std(run.covariance).mean(axis=0), 1e-300)[:, np.newaxis]
    strongest = np.argsort(-moved, axis=None)[:_CURVES]
    kept = [at for at in strongest if moved.flat[at] > 0.01 * moved.max()]
    sizes = []
    for colour, at in zip(CURVES, sorted(kept)):
        i, j = np.unravel_index(at, moved.shape)
        label = f'{space.names[i]} by {output.names[j]}'
        label += _ratio(space.units[i], output.units[j])
        for axis, marker in zip(row, ('-', '.-')):
            axis.plot(time, K[:, i, j], marker, ms=3.0, lw=0.9, color=colour, label=label)
        sizes.append(float(np.abs(K[:, i, j]).mean()))
    if sizes and max(sizes) > _WIDE * min(sizes) > 0.0:
        for axis in row:
            axis.set_yscale('symlog', linthresh=10.0 ** np.floor(np.log10(min(sizes))))


def _ratio(state: str, output: str) -> str:
    """Return the unit of a gain, in brackets after a space; '' for a number."""
    if state == output:
        return ''
    below = f'/({output})' if '/' in output or ' ' in output else f'/{output}'
    return f' [{state or "1"}{below if output else ""}]'
