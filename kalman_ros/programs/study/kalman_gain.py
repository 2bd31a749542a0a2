# SPDX-License-Identifier: Apache-2.0
"""The Kalman gain depends on the ratio of the noises alone.

Five levels that decay to zero, in one filter; they are independent, so each has the gain that it
would have alone. From the first to the last, readings get worse relative to the process noise.
Gains are measured from topics, as the jump of the estimate over the innovation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.control.lqe import LqeDesign, dlqe
from kalman_ros.core import Array
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, close
from .stationary import Stationary, estimation_error
from .study_run import ran
from .systems import linear, plant

DT, SETTLED = 0.05, 20.0
#: Each level moves by dx/dt = -DECAY x + w, where w has this density.
DECAY, DENSITY = 0.5, 1.0
#: Variance of a reading over the variance Q that the noise adds in a step.
RATIOS = np.array([1e-3, 1e-1, 1e1, 1e3, 1e5])
#: Relative distance of a settled gain from its limit: errors decay at least like the level.
CONVERGED = float(np.exp(-2.0 * DECAY * SETTLED))


def levels(deviations: Sequence[float], **others: Any) -> dict[str, Any]:
    """Return the parameters of levels with these standard deviations of the readings."""
    identity = np.eye(len(deviations))
    states = {f'x{index}': '' for index in range(len(identity))}
    density = np.full(len(identity), DENSITY)
    return linear(
        states, -DECAY * identity, identity, density, identity, deviations,
        rate=1.0 / DT, reading__rate=1.0 / DT, **others,
    )  # fmt: skip


STEP = plant(levels([1.0])).sampled(DT)
READING = np.eye(1)


def study(size: float = 1.0) -> Findings:
    """Run the levels for 200 s."""
    R = RATIOS * STEP.Q[0, 0]
    trajectory = ran(levels(np.sqrt(R).tolist(), enabled=False), seconds=SETTLED + 180.0 * size)
    gains, variances = _gains(trajectory), trajectory.covariance[-1].diagonal()
    error = (trajectory.truth - trajectory.estimate)[trajectory.time > SETTLED]
    checks: list[Check] = []
    for index, ratio in enumerate(RATIOS):
        checks += _checks(ratio, gains[index], variances[index], error[:, index])
    checks += _limits(variances, R)
    data = {'ratios': RATIOS.tolist(), 'gains': gains.tolist(), 'variances': variances.tolist()}
    return Findings(
        checks, lambda path: _draw(gains, np.mean(error**2, axis=0), checks, path), data
    )


def _gains(run: Trajectory) -> Array:
    """Return the least-squares ratio of each estimate's jump to its innovation."""
    innovations = run.innovations['reading']
    _, rows, columns = np.intersect1d(
        np.round(run.time[1:] / DT), np.round(innovations.time / DT), return_indices=True
    )
    rows, columns = (
        rows[run.time[1:][rows] > SETTLED],
        columns[innovations.time[columns] > SETTLED],
    )
    jump = (run.estimate[1:] - run.estimate[:-1] * STEP.F[0, 0])[rows]
    innovation = innovations.values[columns]
    return np.asarray((jump * innovation).sum(axis=0) / (innovation**2).sum(axis=0))


def _design(ratio: float) -> LqeDesign:
    return dlqe(STEP.F, READING, STEP.Q, ratio * STEP.Q)


def _checks(ratio: float, gain: float, variance: float, error: Array) -> list[Check]:
    """Compare the gain, the reported variance and the errors with theory."""
    design, at = _design(ratio), f'R/Q = {ratio:g}'
    L, P = float(design.gain[0, 0]), float(design.covariance[0, 0])
    recursion = estimation_error(STEP, READING, ratio * STEP.Q, design.gain)
    return [
        close(f'gain, {at}', '', L, gain, CONVERGED * L),
        close(f'reported variance, {at}', '', P, variance, CONVERGED * P),
        recursion.rms(f'RMS error, {at}', '', 0, error),
    ]


def _limits(variances: Array, R: Array) -> list[Check]:
    """Compare the ends of the sweep with the readings alone, and with the model alone.

    With P- at least Q, 1 - P/R = R / (P- + R) is below R/Q. The other way, a reading takes at
    most P_0^2 / R off the variance P_0 of the model alone, and the model forgets 1 - F^2 of
    that at each step; Q is (1 - F^2) P_0.
    """
    forgets = 1.0 - float(STEP.F[0, 0]) ** 2
    alone = float(Stationary(STEP.F, STEP.Q).covariance[0, 0])
    far = 1.0 / RATIOS[-1] / forgets**2
    return [
        close('variance / that of a reading', '', 1.0, variances[0] / R[0], RATIOS[0]),
        close('variance / that of the model', '', 1.0, variances[-1] / alone, far),
    ]


def _draw(gains: Array, squares: Array, checks: Sequence[Check], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, allowed, picture

    ratios = np.geomspace(RATIOS[0], RATIOS[-1], 100)
    designs = [_design(ratio) for ratio in ratios]
    alone = float(Stationary(STEP.F, STEP.Q).covariance[0, 0])
    with picture(path, 1, 2, (8.0, 3.2)) as (_, ((gain, variance),)):
        gain.semilogx(ratios, [design.gain[0, 0] for design in designs], color=TRUTH)
        gain.semilogx(RATIOS, gains, 'o', color=ESTIMATE)
        gain.set_ylabel('gain L [1]')
        gain.set_title('The weight of a reading')
        variance.loglog(
            ratios,
            [design.covariance[0, 0] for design in designs],
            color=TRUTH,
            label='by Riccati',
        )
        errors = [check for check in checks if check.name.startswith('RMS error')]
        squared = [replace(check, low=check.low**2, high=check.high**2) for check in errors]
        allowed(variance, RATIOS, squared, ESTIMATE)
        variance.loglog(RATIOS, squares, 'o', color=ESTIMATE, label='measured, and allowed')
        variance.loglog(ratios, ratios * STEP.Q[0, 0], '--', color=READING, label='readings alone')
        variance.axhline(alone, ls=':', color=INPUT, label='model alone')
        variance.set_ylim(squares[0] / 2.0, 3.0 * alone)
        variance.set_ylabel('variance of the error [1]')
        variance.set_title('The remaining error')
        for axis in (gain, variance):
            axis.set_xlabel('R/Q: model weighs more to the right [1]')
        variance.legend(loc='lower right')
