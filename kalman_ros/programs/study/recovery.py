# SPDX-License-Identifier: Apache-2.0
"""Loop transfer recovery restores margins and costs noise.

Doyle's plant again, with the same regulator. The estimator assumes noise r^2 B B' at the
input that does not exist (J. Doyle and G. Stein, IEEE Trans. Automatic Control 24(4), 1979).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.analysis.checks import Check, theory
from kalman_ros.control.lqr import cost, lqr
from kalman_ros.control.margins import margins
from kalman_ros.control.recovery import recover
from kalman_ros.control.state_space import StateSpace, state_space
from kalman_ros.core import Array
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import price

from . import Findings, close, mean_square
from .doyle import ONES, SMALL, STRENGTH, A, B, C, system
from .loops import average, controller, lqg_loop, lqr_loop
from .stability_boundary import stability_boundary
from .study_run import StudyRun, ran

RATE = 25.0
#: Values of r in the runs.
ASSUMED = (10.0, 100.0)
#: Weight of (x, u) that selects the square of the input.
INPUT = np.diag([0.0, 0.0, 1.0])


def study(size: float = 1.0) -> Findings:
    """Search two margins, and measure cost and input in 100 s each."""
    checks = []
    for r in ASSUMED:
        upper = margins(_loop(r)).upper_gain.value
        with StudyRun(system(STRENGTH, SMALL, RATE), only=_assumed(r, SMALL)) as run:
            boundary, _ = stability_boundary(run, 'actuator_gain', 1.0, 1.3, 16.0)
        # of the margin beyond 1; the search stops within 0.3 %
        name = f'r = {r:g}: gain margin'
        checks.append(close(name, '', upper, boundary, 0.05 * (upper - 1.0)))
        checks += _measure(r, max(40.0, 100.0 * size))
    return Findings(checks, lambda path: _draw(checks, path))


def _assumed(r: float, scale: float = 1.0) -> dict[str, dict[str, Any]]:
    """Return the parameters of the estimator only: the assumed noise W + r^2 B B'."""
    W = scale**2 * (STRENGTH * ONES + r**2 * B @ B.T)
    return {'estimator': {'model_parameters.noise_density': W.ravel().tolist()}}


def _believed(r: float) -> Scenario:
    return scenarios.build({**system(STRENGTH, rate=RATE), **_assumed(r)['estimator']})


def _real() -> Scenario:
    return scenarios.build(system(STRENGTH, rate=RATE))


def _loop(r: float) -> StateSpace:
    return lqg_loop(_real(), believed=_believed(r))


def _input_rms(r: float) -> float:
    return float(np.sqrt(average(_real(), INPUT, 1, controller(_real(), _believed(r))).mean))


def _measure(r: float, seconds: float) -> list[Check]:
    """Compare cost and input over topics with theory; the bounds are their scatter."""
    parameters = {**system(STRENGTH, rate=RATE), 'initial_state': [0.0, 0.0]}
    settled = theory(_real()).settling_time
    trajectory = ran(parameters, only=_assumed(r), seconds=settled + seconds)
    z = np.hstack((trajectory.truth, trajectory.input))[trajectory.time >= settled]
    checks = []
    cost = RATE * price(_real()).weight
    for name, unit, weight in (('cost', '1/s', cost), ('RMS of the input', '', INPUT)):
        expected = average(_real(), weight, len(z), controller(_real(), _believed(r)))
        value = float(np.mean(np.einsum('ki,ij,kj->k', z, weight, z)))
        checks.append(mean_square(f'r = {r:g}: {name}', unit, expected, value, root=not unit))
    return checks


def _draw(checks: Sequence[Check], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, READING, TRUTH, allowed, picture
    from kalman_ros.report.style import INPUT as ORANGE

    strengths: Array = np.asarray(np.geomspace(0.3, 1000.0, 40), dtype=float)
    plant = state_space(A, B, C)
    K = lqr(A, B, cost(STRENGTH * ONES, [1.0], (2, 1))).gain
    designs = recover(plant, K, (STRENGTH * ONES, np.eye(1)), strengths.tolist())
    guarantee = margins(lqr_loop(_real())).upper_gain.value
    by_name = {check.name: check for check in checks}
    with picture(path, 1, 2, (9.0, 3.3)) as (_, ((gain, noise),)):
        gain.plot(
            strengths, [margins(design.loop).upper_gain.value for design in designs], '--',
            color=READING, label='in continuous time',
        )  # fmt: skip
        gain.plot(
            strengths, [margins(_loop(r)).upper_gain.value for r in strengths.tolist()],
            color=ESTIMATE, label=f'sampled at {RATE:g} Hz',
        )  # fmt: skip
        gain.axhline(guarantee, color=TRUTH, lw=0.8, ls=':', label='true state, sampled')
        gain.set_ylabel('upper gain margin (log)')
        gain.set_title('The margin recovers')
        noise.plot(strengths, [_input_rms(r) for r in strengths.tolist()], color=ESTIMATE)
        noise.set_ylabel('RMS of the input (log)')
        noise.set_title('Noise at the input grows')
        for axis, label in ((gain, 'gain margin'), (noise, 'RMS of the input')):
            measured = [by_name[f'r = {r:g}: {label}'] for r in ASSUMED]
            allowed(axis, ASSUMED, measured, ORANGE)
            values = [check.measured.real for check in measured]
            axis.plot(ASSUMED, values, 'o', color=ORANGE, ms=6, label='measured, and allowed')
            axis.set_xscale('log')
            axis.set_yscale('log')
            axis.set_xlabel('r, input noise that the estimator assumes (log)')
        gain.legend(loc='center left')
