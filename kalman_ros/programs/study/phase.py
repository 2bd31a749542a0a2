# SPDX-License-Identifier: Apache-2.0
"""LQR keeps 60 degrees of phase at the plant's input; sampling takes a known part of them.

The dearest input leaves the least: it only mirrors an unstable mode a, and |1 + l| is 1 at all
frequencies, or exp(-a dt) when sampled. Pairs of copies of the mode share their actuators: each
input is turned by an angle into the other, which the controller does not know. With z the pair as
one complex number that is a factor exp(j angle) of the loop, so the angle at which pairs start to
grow is the phase margin at the plant's input.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.analysis.checks import Check
from kalman_ros.control.margins import margins
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import Array
from kalman_ros.scenario import build
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, close
from .loops import lqr_loop
from .study_run import ON_TRUTH, StudyRun
from .systems import linear

DT, SECONDS = 0.2, 40.0
#: Unstable modes in 1/s, for which this loop is fast and slow, and the weight of their states.
MODES, CHEAP = (0.1, 1.0), 1e-9
#: Degrees by which pairs are turned, from the computed margin.
TURNS = (-25.0, -10.0, -3.0, -1.0, 1.0, 3.0)
GUARANTEE = 60.0


@dataclass(frozen=True)
class Pairs:
    """Copies of one mode: angles (pairs,) in degrees, growth (pairs,) in 1/s, and their loop."""

    mode: float
    angle: Array
    growth: Array
    loop: StateSpace

    @property
    def margin(self) -> float:
        """Measured angle without growth, in degrees."""
        return float(np.interp(0.0, self.growth, self.angle))


def study(size: float = 1.0) -> Findings:
    """Run all pairs at once for 40 s, at any size."""
    loops = {mode: lqr_loop(build(_system([mode], [0.0], [1.0]))) for mode in MODES}
    angles = {
        mode: np.degrees(margins(loop).lag.value) + np.array(TURNS) for mode, loop in loops.items()
    }
    modes = np.repeat(MODES, 2 * len(TURNS))
    turned = np.radians(np.concatenate(list(angles.values())))
    start = np.tile([1.0, 0.0], len(turned))
    believed = _system(modes, np.zeros(len(turned)), start)
    real = _system(modes, turned, start)
    plant = {'model_parameters.B': real['model_parameters.B']}
    with StudyRun(believed, only={'plant': plant}, remaps=ON_TRUTH) as run:
        run.advance(SECONDS)
        growth = _growth(run.trajectory()).reshape(len(MODES), -1)
    pairs = [Pairs(mode, angles[mode], row, loops[mode]) for mode, row in zip(MODES, growth)]
    return Findings(_checks(pairs), lambda path: _draw(pairs, path))


def _system(
    modes: Array | list[float], turned: Array | list[float], start: Array | list[float]
) -> dict[str, object]:
    """Return modes whose inputs are turned in pairs, by angles in rad."""
    n = len(modes)
    turns = [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in turned]
    B = block_diag(*turns) if n > 1 else np.eye(1)
    return linear(
        {f'x{k}': '' for k in range(n)}, np.diag(modes), B, np.full(n, 1e-24), np.eye(n),
        [1.0] * n, rate=1.0 / DT, reading__rate=1.0 / DT, state_cost=[CHEAP] * n,
        initial_state=list(start),
    )  # fmt: skip


def _growth(run: Trajectory) -> Array:
    """Return the rate (pairs,) of the logarithm of each pair's size."""
    size = np.hypot(run.truth[:, 0::2], run.truth[:, 1::2])
    return np.asarray(np.polyfit(run.time, np.log(size), 1)[0])


def _checks(pairs: list[Pairs]) -> list[Check]:
    """Compare the angles with the margin of the loop, and with the margin that |1 + l| leaves."""
    checks = []
    for pair in pairs:
        at = f'a dt = {pair.mode * DT:g}'
        computed = float(np.degrees(margins(pair.loop).lag.value))
        left = 2.0 * float(np.degrees(np.arcsin(0.5 * np.exp(-pair.mode * DT))))
        checks += [
            close(f'phase margin, {at}', 'deg', computed, pair.margin, 0.05),
            close(f'2 asin(exp(-a dt) / 2), {at}', 'deg', left, pair.margin, 0.05),
        ]
    return checks


def _draw(pairs: list[Pairs], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with

    with figure_with(path, 1, 2, (9.0, 3.4)) as (_, ((circle, rates),)):
        turn = np.linspace(0.0, 2.0 * np.pi, 200)
        circle.plot(np.cos(turn), np.sin(turn), color=READING, lw=0.8)
        circle.plot(-1.0, 0.0, 'x', color=TRUTH, ms=8)
        rates.axhline(0.0, color=READING, lw=0.8)
        rates.axvline(GUARANTEE, color=TRUTH, lw=1.0, ls=':', label='60 degrees')
        for pair, colour in zip(pairs, (ESTIMATE, INPUT)):
            label = f'a dt = {pair.mode * DT:g}'
            loop = pair.loop.response(np.geomspace(1e-2 * pair.mode, np.pi / DT, 400))[:, 0, 0]
            circle.plot(loop.real, loop.imag, color=colour, label=label)
            fine = np.linspace(20.0, 64.0, 60)
            rates.plot(fine, [_turned_growth(pair.loop, a) / pair.mode for a in fine],
                       color=colour, lw=1.0)  # fmt: skip
            rates.plot(pair.angle, pair.growth / pair.mode, 'o', color=colour, ms=4,
                       label=f'{label}: {pair.margin:.1f} degrees')  # fmt: skip
        title, parts = r'Nyquist: $|1 + \ell|$ is constant', (r'Re $\ell$', r'Im $\ell$')
        circle.set(title=title, xlabel=parts[0], ylabel=parts[1], aspect='equal')
        circle.legend(loc='lower right', fontsize=8)
        rates.set(title='Growth of the turned pairs', xlabel='angle [deg]',
                  ylabel='growth / a')  # fmt: skip
        rates.legend(loc='upper left', fontsize=8)


def _turned_growth(loop: StateSpace, angle: float) -> float:
    """Return the growth in 1/s of a loop times exp(j angle), the step of a pair."""
    turned = loop.A - np.exp(1j * np.radians(angle)) * (loop.B @ loop.C)
    return float(np.log(np.max(np.abs(np.linalg.eigvals(turned)))) / DT)
