# SPDX-License-Identifier: Apache-2.0
"""Modes decay, stay or grow by the sign of their eigenvalue.

Three independent modes without an input. The rates are those of the logarithm of the plant's
ground truth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kalman_ros.control.stability import modes
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, close
from .study_run import ran
from .systems import linear

RATES = {'decays': -0.8, 'stays': 0.0, 'grows': 0.4}


def study(size: float = 1.0) -> Findings:
    """Run the three modes for 8 s."""
    A = np.diag(list(RATES.values()))
    system = linear(
        dict.fromkeys(RATES, ''), A, np.eye(3), np.full(3, 1e-12), np.eye(3), [0.01] * 3,
        initial_state=[1.0] * 3, enabled=False,
    )  # fmt: skip
    trajectory = ran(system, seconds=8.0 * max(size, 0.25))
    checks = []
    for index, (name, rate) in enumerate(RATES.items()):
        slope = np.polyfit(trajectory.time, np.log(np.abs(trajectory.truth[:, index])), 1)[0]
        checks.append(close(f'rate of the mode that {name}', '1/s', rate, float(slope), 1e-3))
    outcomes = sorted((mode.pole.real, mode.fate) for mode in modes(A))
    predicted = [outcome for _, outcome in outcomes]
    agree = float(predicted == list(RATES))
    checks.append(close('modes classified as they went / 3', '', 1.0, agree, 0.0))
    return Findings(checks, lambda path: _draw(trajectory, path))


def _draw(run: Trajectory, path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, TRUTH, legend_below, picture

    colours = (ESTIMATE, TRUTH, INPUT)
    with picture(path, 1, 1, (6.5, 3.0)) as (figure, ((axis,),)):
        for index, ((name, rate), colour) in enumerate(zip(RATES.items(), colours)):
            axis.plot(run.time, run.truth[:, index], color=colour, label=f'{name}: {rate:g} 1/s')
            axis.plot(run.time, np.exp(rate * run.time), '--', color='white', lw=0.8)
        axis.set_yscale('log')
        axis.set_ylabel('state (log)')
        axis.set_title('What eigenvalues mean (dashed: as predicted)')
        legend_below(figure, axis)
