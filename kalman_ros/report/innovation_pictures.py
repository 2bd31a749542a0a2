# SPDX-License-Identifier: Apache-2.0
"""Pictures of the innovations of a run: time series, distribution, and autocorrelation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators import filter_class
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Innovations, Trajectory

from .style import BOUND, ESTIMATE, SIGMAS, TRUTH, figure_with, legend_below, time_label

#: Limit of the histogram in standard deviations.
_WIDEST = 4.0
#: Largest lag, in readings.
_LAGS = 40
#: 95 % bound of a correlation of white noise, times the root of the number of readings.
_WHITE = 1.96


def innovations(scenario: Scenario, run: Trajectory, path: Path | None) -> Any:
    """Draw the innovations of every sensor, their histogram and their autocorrelation.

    A consistent filter has white innovations with the covariance S that it expects (R. Mehra, On
    the identification of variances and adaptive Kalman filtering, IEEE Trans. Automatic Control
    15(2), 1970).

    Returns
    -------
    Axes with three columns: time series, histogram, autocorrelation.
    """
    rows = [
        (name, column)
        for name, source in scenario.enabled.items()
        for column in range(source.sensor.output.size)
        if len(run.innovations[name].time)
    ]
    size = (9.5, 1.5 * max(1, len(rows)) + 0.7)
    ratios = {'width_ratios': (4.0, 1.1, 1.5)}
    kind = filter_class(scenario.filter)
    white = 'and white' if kind.optimal or kind.mixture else 'but not white'
    shows = (
        f'Readings minus their predictions: inside the bounds, Gaussian {white} if all is right.'
    )
    with figure_with(path, max(1, len(rows)), 3, size, shows, gridspec_kw=ratios) as (
        figure,
        axes,
    ):
        for row, (name, column) in zip(axes, rows):
            series = run.innovations[name]
            output = scenario.sensors[name].sensor.output
            _draw_over_time(row[0], series, column)
            row[0].set_ylabel(f'{name}\n{output.label(output.names[column])}')
            normalized = series.values[:, column] / series.std[:, column]
            _draw_histogram(row[1], normalized)
            _draw_autocorrelation(row[2], normalized)
        for axis, title in zip(
            axes[0], ('Innovations and their expected width', 'In sigma', 'Autocorrelation')
        ):
            axis.set_title(title)
        for upper in axes[:-1].flat:
            upper.tick_params(labelbottom=False)
        for axis, label in zip(axes[-1], (time_label(), 'sigma', 'lag [readings]')):
            axis.set_xlabel(label)
        legend_below(figure, axes[0, 0], axes[0, 1], axes[0, 2])
    return axes


def _draw_over_time(axis: Any, series: Innovations, column: int) -> None:
    """Draw innovations with their bounds, and count the innovations outside of the panel."""
    axis.plot(series.time, series.values[:, column], '.', ms=2.0, color=TRUTH, label='innovation')
    for sign in (-SIGMAS, SIGMAS):
        axis.plot(
            series.time, sign * series.std[:, column], color=ESTIMATE, lw=1.0,
            label=f'{SIGMAS:g} sigma expected' if sign > 0 else None,
        )  # fmt: skip
    sizes = np.abs(series.values[:, column])
    expected = SIGMAS * float(np.quantile(series.std[:, column], 0.9))
    most = 1.2 * max(expected, float(np.quantile(sizes, 0.999, method='lower')))
    axis.set_ylim(-most, most)
    outside = int(np.sum(sizes > most))
    if outside:
        axis.set_title(f'{outside} outside of the panel', loc='right', fontweight='normal')


def _draw_histogram(axis: Any, normalized: Array) -> None:
    """Draw the histogram of normalized innovations (N,), and the density of N(0, 1)."""
    bars = int(np.clip(2.0 * np.cbrt(len(normalized)), 6, 34)) // 2 * 2 + 1
    edges = np.linspace(-_WIDEST, _WIDEST, bars + 1)
    counts, _ = np.histogram(np.clip(normalized, -_WIDEST, _WIDEST), edges)
    density = counts / (len(normalized) * np.diff(edges))
    axis.stairs(density, edges, fill=True, color=BOUND, alpha=0.5)
    x = np.linspace(-_WIDEST, _WIDEST, 121)
    axis.plot(x, np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi), color=TRUTH, lw=0.9, label='N(0, 1)')
    axis.set_xticks((-3, 0, 3))
    axis.set_yticks(())


def _draw_autocorrelation(axis: Any, normalized: Array) -> None:
    """Draw the autocorrelation of normalized innovations (N,)."""
    values = correlations(normalized)
    lags = np.arange(1, len(values) + 1)
    bound = _WHITE / np.sqrt(len(normalized))
    axis.axhspan(-bound, bound, color=BOUND, alpha=0.25, lw=0, label='95% of white noise')
    axis.vlines(lags, 0.0, values, color=TRUTH, lw=1.0)
    axis.axhline(0.0, color=TRUTH, lw=0.5)
    most = max(0.3, 2.0 * bound, 1.1 * float(np.abs(values).max(initial=0.0)))
    axis.set_ylim(-most, most)


def correlations(normalized: Array) -> Array:
    """Return the autocorrelation (L,) of a series (N,) at the lags 1 to L, L at most N / 4.

    r_k = sum_i v_i v_{i+k} / sum_i v_i^2. The mean of innovations is zero, and not subtracted.
    """
    power = float(normalized @ normalized)
    last = min(_LAGS, len(normalized) // 4)
    if power == 0.0:
        return np.zeros(last)
    return np.array([normalized[:-k] @ normalized[k:] / power for k in range(1, last + 1)])
