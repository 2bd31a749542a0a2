# SPDX-License-Identifier: Apache-2.0
"""Pictures of a design: poles, margins of the loops, and accuracy of the estimate."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Circle
from matplotlib.ticker import LogLocator, MultipleLocator, NullFormatter

from kalman_ros.analysis.design_report import DesignReport
from kalman_ros.analysis.design_warnings import loop_names
from kalman_ros.analysis.input_loops import InputLoops, Loop
from kalman_ros.control.stability import Mode
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import Array

from .style import (
    CURVES,
    ESTIMATE,
    INPUT,
    READING,
    TRUTH,
    canvas,
    envelope,
    legend_below,
    log_ticks,
    picture,
    time_label,
    time_unit,
)

#: Poles whose magnitudes differ by more than this factor are drawn on logarithmic axes.
WIDE = 200.0

#: Colour of the unstable half plane.
GROWTH = '#f6e9e2'

#: Range of the gains that are drawn, in dB.
GAINS = (-45.0, 45.0)

#: Sentence below the title of a picture of loops.
_LOOPS = 'How far gain and phase of the loop may change before it is unstable.'

#: Number of frequencies of a response.
_POINTS = 800

#: Share by which deviations have settled, and the least number of steps that are shown.
_NEAR, _LEAST = 0.02, 50


def draw_all(report: DesignReport, folder: Path) -> list[Path]:
    """Draw every picture of a design into ``folder`` and return their paths."""
    pictures = {'poles.png': poles, 'uncertainty.png': uncertainty}
    if report.regulator:
        pictures['loops.png'] = loops
    for name, draw in pictures.items():
        draw(report, folder / name)
    return [folder / name for name in pictures]


def poles(report: DesignReport, path: Path | None) -> None:
    """Draw the poles of the open loop, of the regulator and of the estimator."""
    groups = [('open loop', report.modes, 'x', TRUTH)]
    if report.regulator:
        groups.append(('regulator', report.regulator.modes, 's', INPUT))
    if report.estimator:
        groups.append(('estimator', report.estimator.modes, 'o', ESTIMATE))
    shows = 'Where the model, the regulator and the estimator have their poles: left decays.'
    with canvas(path, (6.4, 4.4), shows) as figure:
        axis = figure.add_subplot()
        all_poles = np.concatenate([_all_poles(modes) for _, modes, _, _ in groups])
        reach = float(np.abs(all_poles).max()) or 1.0
        right_limit = max(1.3 * float(all_poles.real.max()), 0.2 * reach)
        axis.axvspan(0.0, right_limit, color=GROWTH, lw=0.0, zorder=0)
        axis.set_xlim(1.15 * float(all_poles.real.min()) - 0.05 * reach, right_limit)
        high = 1.2 * max(float(all_poles.imag.max()), 0.4 * reach)
        axis.set_ylim(-high, high)
        axis.axhline(0.0, color=READING, lw=0.8)
        axis.axvline(0.0, color=READING, lw=0.8)
        for label, modes, marker, colour in groups:
            s = _all_poles(modes)
            axis.plot(s.real, s.imag, marker, ms=7, mew=1.5, mfc='none', color=colour,
                      label=label, zorder=3)  # fmt: skip
        sizes = np.abs(all_poles[np.abs(all_poles) > 0.0])
        if sizes.size and sizes.max() > WIDE * sizes.min():
            inner = 10.0 ** np.floor(np.log10(sizes.min()))
            axis.set_xscale('symlog', linthresh=inner)
            axis.set_yscale('symlog', linthresh=inner)
            axis.set_xlim(right=max(3.0 * float(all_poles.real.max()), inner))
        axis.set_xlabel(f'real part [1/{time_unit()}]')
        axis.set_ylabel(f'imaginary part [rad/{time_unit()}]')
        axis.set_title('Poles: unstable on the right, fast on the left')
        legend_below(figure, axis, markerscale=1.0)


def _all_poles(modes: Sequence[Mode]) -> Any:
    """Return all finite poles, including the conjugates."""
    s = np.array([mode.pole for mode in modes if np.isfinite(mode.pole)], dtype=complex)
    return np.concatenate((s, s[s.imag > 0.0].conj()))


def uncertainty(report: DesignReport, path: Path | None) -> None:
    """Draw the error of each state from the initial belief to its steady state."""
    space, prediction = report.scenario.model.state, report.prediction
    columns = 2 if space.size > 1 else 1
    rows = -(-space.size // columns)
    shown = prediction.time <= _settled(prediction.time, prediction.std)
    shows = 'Computed before anything runs: how well each state will be known.'
    with canvas(path, (4.2 * columns, 1.8 * rows + 1.1), shows) as figure:
        axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
        for index, (axis, name) in enumerate(zip(axes, space.names)):
            curve = envelope(prediction.time[shown], prediction.std[shown, index])
            axis.semilogy(*curve, color=ESTIMATE, lw=1.2, label='estimate')
            if report.estimator:
                steady = float(report.estimator.std[index])
                axis.axhline(steady, color=ESTIMATE, lw=0.8, ls=':')
                axis.set_title(f'settles at {steady:.3g}', loc='right', fontweight='normal')
            if name in report.sensor_std:
                axis.axhline(report.sensor_std[name], color=READING, lw=1.2, label='one reading')
            low, high = axis.get_ylim()
            axis.set_ylim(low / 1.4, high * 1.4)  # leaves room for a second tick
            axis.set_ylabel(f'std of\n{space.label(name)}')
            log_ticks(axis)
        axes[0].set_title('From the first belief on')
        for axis in axes[space.size :]:
            axis.set_visible(False)
        for axis in axes[max(0, space.size - columns) : space.size]:
            axis.set_xlabel(time_label())
            axis.tick_params(labelbottom=True)
        legend_below(figure, max(axes, key=lambda axis: len(axis.get_legend_handles_labels()[1])))


def _settled(time: Array, std: Array) -> float:
    """Return three times the time after which deviations (N, n) stay as in the last tenth."""
    last = std[-max(1, len(std) // 10) :]
    low, high = (1.0 - _NEAR) * last.min(axis=0), (1.0 + _NEAR) * last.max(axis=0)
    (off,) = np.nonzero(((std < low) | (std > high)).any(axis=1))
    first = time[off[-1]] if off.size else time[0]
    return float(min(time[-1], max(3.0 * first, time[min(len(time) - 1, _LEAST)])))


def loops(report: DesignReport, path: Path | None) -> None:
    """Draw Bode and Nyquist plots at each input, for feedback of the state and of the estimate."""
    channels = report.regulator.loops if report.regulator else ()
    known, estimated = loop_names(report.scenario.law)
    names = f'{known}, all states known', f'{estimated}, with the estimate'
    feedback_loops(channels, report.scenario.rate, path, names)


def feedback_loops(
    channels: Sequence[InputLoops], rate: float, path: Path | None, names: tuple[str, str]
) -> None:
    """Draw Bode and Nyquist plots of a feedback at each input.

    Parameters
    ----------
    channels
        The loop of each input.
    rate
        Samples a second; infinite in continuous time.
    path
        Where to save the picture; None to show it.
    names
        Names in the legend: of the loop with all states known, and with the estimate.
    """
    with canvas(path, (9.5, 4.0 * len(channels) + 0.3), _LOOPS) as figure:
        parts = figure.subfigures(len(channels), 1, squeeze=False)[:, 0]
        for part, channel in zip(parts, channels):
            _draw_input(part, channel, names, rate)
        legend_below(figure, parts[-1].axes[-1])


def estimator_response(response: StateSpace, states: Sequence[str], path: Path | None) -> None:
    """Draw the magnitudes of the response of an estimate to its readings.

    Parameters
    ----------
    response
        From the readings to the states.
    states
        Names of the states.
    path
        Where to save the picture; None to show it.
    """
    poles, dt = response.poles, response.dt
    speeds = np.abs(poles if dt is None else np.log(poles[poles != 0.0]) / dt)
    speeds = speeds[speeds > 0.0] if np.any(speeds > 0.0) else np.ones(1)
    high = 30.0 * float(speeds.max()) if dt is None else pi / dt
    w = np.geomspace(min(speeds.min(), high) / 30.0, high, 400)
    size = np.abs(response.response(w))
    inputs = size.shape[2]
    shows = 'How much of a reading is in the estimate, by frequency.'
    with picture(path, inputs, 1, (7.0, 2.6 * inputs + 0.8), shows) as (figure, axes):
        for k, axis in enumerate(axes[:, 0]):
            for index, name in enumerate(states):
                axis.loglog(w, size[:, index, k], color=CURVES[index % len(CURVES)], lw=1.2,
                            label=name)  # fmt: skip
            log_ticks(axis)
            axis.set_ylabel('|x / y|' if inputs == 1 else f'|x / y{k}|')
        axes[-1, 0].set_xlabel('frequency [rad/s]')
        axes[0, 0].set_title('Response of the estimate to the readings')
        legend_below(figure, axes[0, 0])


def _draw_input(part: Any, channel: InputLoops, names: tuple[str, str], rate: float) -> None:
    """Draw the loop at one input: gain and phase on the left, Nyquist plot on the right."""
    grid = part.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
    gain = part.add_subplot(grid[0, 0])
    phase = part.add_subplot(grid[1, 0], sharex=gain)
    plane = part.add_subplot(grid[:, 1])
    drawn = {names[0]: (channel.known, TRUTH)}
    if channel.estimated is not None:
        drawn[names[1]] = (channel.estimated, ESTIMATE)
    w = _frequencies([loop for loop, _ in drawn.values()], rate)
    for label, (loop, colour) in drawn.items():
        _draw_bode((gain, phase), loop, w, colour, 'above' if loop is channel.known else 'below')
        _draw_nyquist(plane, loop, w, colour, label)
    _draw_references(gain, phase, plane)
    gain.set_title(f'Loop at {channel.input}')


def _frequencies(loops: Sequence[Loop], rate: float) -> Array:
    """Return frequencies (k,) in rad/s, from below all margins to nearly the Nyquist frequency."""
    margins = [loop.margins or loop.prompt for loop in loops]
    marks = [
        mark.frequency for m in margins for mark in (m.lower_gain, m.upper_gain, m.lag, m.lead)
    ]
    finite = [mark for mark in marks if 0.0 < mark < inf]
    low = min(finite, default=0.01 * pi * rate if rate < inf else 1.0)
    high = 0.97 * pi * rate if rate < inf else 30.0 * max(finite, default=10.0)
    return np.asarray(np.geomspace(0.1 * low, high, _POINTS), dtype=float)


def _draw_bode(axes: tuple[Any, Any], loop: Loop, w: Array, colour: str, side: str) -> None:
    """Draw gain and phase of one loop, and its margins with labels on one ``side``."""
    gain, phase = axes
    L = loop.broken.response(w)[:, 0, 0]
    angle = np.degrees(np.unwrap(np.angle(L)))
    margins = loop.margins or loop.prompt
    lag = margins.lag
    if isfinite(lag.value):  # add full turns, such that the lag margin ends at -180 degrees
        angle -= 180.0 + _interpolate(lag.frequency, w, angle) - np.degrees(lag.value)
    gain.semilogx(w, 20.0 * np.log10(np.abs(L)), color=colour, lw=1.3)
    phase.semilogx(w, angle, color=colour, lw=1.3)
    if loop.margins is None:
        return
    for margin in (margins.lower_gain, margins.upper_gain):
        if w[0] < margin.frequency < w[-1]:
            size = -20.0 * np.log10(margin.value)
            _draw_margin(
                gain, margin.frequency, (0.0, size), f'{margin.value:.2g}', (colour, side)
            )
    for margin, sign in ((margins.lag, -1.0), (margins.lead, 1.0)):
        if w[0] < margin.frequency < w[-1]:
            start, size = _interpolate(margin.frequency, w, angle), np.degrees(margin.value)
            _draw_margin(
                phase,
                margin.frequency,
                (start, start + sign * size),
                f'{size:.0f}°',
                (colour, side),
            )


def _interpolate(frequency: float, w: Array, values: Array) -> float:
    return float(np.interp(np.log(frequency), np.log(w), values))


def _draw_margin(
    axis: Any, frequency: float, ends: tuple[float, float], text: str, look: tuple[str, str]
) -> None:
    """Draw a margin from the loop to the stability boundary."""
    colour, side = look
    axis.plot([frequency] * 2, ends, color=colour, lw=2.4, alpha=0.6)
    above = side == 'above'
    axis.annotate(
        text, (frequency, max(ends) if above else min(ends)), xytext=(0, 3 if above else -3),
        textcoords='offset points', ha='center', va='bottom' if above else 'top', color=colour,
        fontsize=8, bbox={'fc': 'white', 'ec': 'none', 'alpha': 0.8, 'pad': 0.5}, zorder=4,
    )  # fmt: skip


def _draw_nyquist(plane: Any, loop: Loop, w: Array, colour: str, label: str) -> None:
    """Draw the Nyquist plot of one loop, and the disk of its margin."""
    L = loop.broken.response(w)[:, 0, 0]
    for part in (L, L.conj()):
        plane.plot(part.real, part.imag, color=colour, lw=1.3, label=label if part is L else None)
    if loop.margins is None or loop.margins.disk.alpha >= 2.0:
        return
    ends = -loop.margins.disk.lower_gain, -loop.margins.disk.upper_gain
    centre, radius = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[0] - ends[1])
    plane.add_patch(Circle((centre, 0.0), radius, color=colour, alpha=0.12, lw=0.0))


def _draw_references(gain: Any, phase: Any, plane: Any) -> None:
    """Label the axes, and draw the references: gain 1, phase of odd half turns, and -1."""
    gain.axhline(0.0, color=READING, lw=0.8)
    gain.set_ylabel('gain [dB]')
    low, high = gain.get_ylim()
    gain.set_ylim(max(low, GAINS[0]), min(high, GAINS[1]))
    gain.tick_params(labelbottom=False)
    low, high = phase.get_ylim()
    phase.set_ylim(low - 40.0, high + 20.0)
    for odd in range(int(low // 180) - 1, int(high // 180) + 2):
        if odd % 2 and low - 20.0 <= 180.0 * odd <= high + 20.0:
            phase.axhline(180.0 * odd, color=READING, lw=0.8)
    phase.yaxis.set_major_locator(MultipleLocator(90.0))
    phase.set_ylabel('phase [deg]')
    phase.set_xlabel('frequency [rad/s]')
    phase.xaxis.set_major_locator(LogLocator())
    phase.xaxis.set_minor_formatter(NullFormatter())
    plane.add_patch(Circle((0.0, 0.0), 1.0, fill=False, ls=':', color=READING))
    plane.plot(-1.0, 0.0, '+', color='#c0182b', ms=11, mew=1.8, zorder=5)
    plane.set_aspect('equal')
    plane.set_xlim(-3.0, 1.5)
    plane.set_ylim(-2.25, 2.25)
    plane.set_xlabel('real part')
    plane.set_ylabel('imaginary part')
    plane.set_title('Nyquist: disks about -1 that the loops avoid')
