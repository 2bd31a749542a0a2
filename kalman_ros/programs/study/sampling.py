# SPDX-License-Identifier: Apache-2.0
"""A sampled loop is at most as fast as one sample; more gain only rings, then grows.

Carts that obey dx/dt = u are held by u = -p x, the gain of a pole at -p in continuous time.
Sampled, their pole is 1 - p dt: at p dt = 1 the state is gone in one sample, at 2 it grows. If the
input is a sample late, the poles are those of z^2 - z + p dt: the fastest halve the state in a
sample, and p dt = 1 is the boundary.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.core import Array
from kalman_ros.scenario import build
from kalman_ros.scenario.regulator import feedback

from . import Findings, close
from .study_run import ON_TRUTH, StudyRun
from .systems import linear

DT, STEPS = 0.1, 30
#: p dt of each cart, and the largest one that is evaluated with the delay.
GAINS = np.array([0.15, 0.25, 0.5, 0.9, 1.0, 1.1, 1.5, 1.95, 2.05])
LATE_GAINS = 1.1
#: Process noise, and the smallest state in m in which a pole can be seen beside it.
TINY, VISIBLE = 1e-12, 1e-7


@dataclass(frozen=True)
class Carts:
    """The states (N, carts) after the start, and the size (carts,) of the slowest pole in z."""

    states: Array
    poles: Array


def study(size: float = 1.0) -> Findings:
    """Run nine carts for 3 s, then again with a delay of one sample."""
    n = len(GAINS)
    system = linear(
        {f'x{k}': 'm' for k in range(n)}, np.zeros((n, n)), np.eye(n), np.full(n, TINY**2),
        np.eye(n), [0.01] * n, rate=1.0 / DT, reading__rate=1.0 / DT, initial_state=[1.0] * n,
    )  # fmt: skip
    gain = feedback(build(system)).gain.diagonal()
    actuators = {'plant': {'actuator_gain': (GAINS / DT / gain).tolist()}}
    with StudyRun(system, only=actuators, remaps=ON_TRUTH) as run:
        run.advance(STEPS * DT)
        prompt = run.trajectory().truth
        run.set_parameter('actuator_delay', DT)
        run.trigger('plant/reset')
        run.advance((STEPS + 1) * DT)
        late = run.trajectory().truth[len(prompt) :]
    carts = {'prompt': _prompt(prompt), 'late': _late(late)}
    return Findings(_checks(carts), lambda path: _draw(carts, path))


def _prompt(states: Array) -> Carts:
    """Fit x' = z x to each cart."""
    poles = []
    for x in states.T:
        kept = np.abs(x[:-1]) > VISIBLE
        poles.append(x[1:][kept] @ x[:-1][kept] / (x[:-1][kept] @ x[:-1][kept]))
    return Carts(states, np.array(poles))


def _late(states: Array) -> Carts:
    """Fit x'' = a x' + b x to each cart, and return the larger root of z^2 - a z - b."""
    poles = []
    for x in states.T:
        before = np.stack((x[1:-1], x[:-2]), axis=1)
        weight = 1.0 / np.linalg.norm(before, axis=1)
        a, b = np.linalg.lstsq(before * weight[:, np.newaxis], x[2:] * weight, rcond=None)[0]
        poles.append(np.max(np.abs(np.roots([1.0, -a, -b]))))
    return Carts(states, np.array(poles))


def late_pole(gains: Array) -> Array:
    """Return the size of the larger root of z^2 - z + p dt, for p dt of any shape."""
    root = np.sqrt(np.asarray(1.0 - 4.0 * gains, dtype=complex))
    return np.asarray(np.abs(0.5 + 0.5 * root))


def _checks(carts: dict[str, Carts]) -> list[Check]:
    checks = [
        close(f'pole at p dt = {gain:g}', '', 1.0 - gain, float(z), 1e-6)
        for gain, z in zip(GAINS, carts['prompt'].poles)
    ]
    once = carts['prompt'].states[1:, list(GAINS).index(1.0)]
    checks.append(close('left after one sample at p dt = 1', 'm', 0.0, float(once[0]), 1e-9))
    for gain, z in zip(GAINS, carts['late'].poles):
        if gain <= LATE_GAINS:
            expected = float(late_pole(gain))
            checks.append(close(f'late: size at p dt = {gain:g}', '', expected, float(z), 1e-4))
    return checks


def _draw(carts: dict[str, Carts], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with, shades

    with figure_with(path, 1, 2, (9.0, 3.4)) as (_, ((states, poles),)):
        shown = (0.25, 1.0, 1.5, 2.05)
        for gain, colour in zip(shown, shades(len(shown))):
            x = carts['prompt'].states[:16, list(GAINS).index(gain)]
            states.plot(DT * np.arange(len(x)), x, '.-', color=colour, label=f'{gain:g}', lw=1.0)
        states.set(title='A cart, its input without delay', ylabel='x [m]', xlabel='time [s]',
                   xlim=(-0.05, 1.95))  # fmt: skip
        states.legend(title='p dt', loc='upper right', fontsize=8)
        fine = np.linspace(0.0, 2.2, 200)
        poles.plot(fine, np.exp(-fine), ':', color=TRUTH, label='wanted: exp(-p dt)')
        poles.plot(fine, np.abs(1.0 - fine), color=ESTIMATE, label='no delay: |1 - p dt|')
        poles.plot(GAINS, np.abs(carts['prompt'].poles), 'o', color=ESTIMATE, ms=4)
        poles.plot(fine, late_pole(fine), color=INPUT, label='a sample late')
        poles.plot(GAINS, carts['late'].poles, 's', color=INPUT, ms=4)
        poles.axhline(1.0, color=READING, lw=0.8)
        poles.set(title='What a sample leaves (marks: measured)', ylabel='size of the pole in z',
                  xlabel='p dt', ylim=(0.0, 1.5))  # fmt: skip
        poles.legend(loc='upper center', fontsize=8)
