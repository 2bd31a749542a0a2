# SPDX-License-Identifier: Apache-2.0
"""LQG has no guaranteed margins: 6 % of gain destabilise it.

J. Doyle, Guaranteed Margins for LQG Regulators, IEEE Trans. Automatic Control 23(4), 1978: with
weights q and noise sigma of that plant, K = f [1 1] and L = d [1 1]', f = 2 + sqrt(4 + q),
d = 2 + sqrt(4 + sigma), the cost is 5 f (sigma + f d), and the margin goes to zero.
"""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.analysis.checks import Check, theory
from kalman_ros.control.compensator import compensator
from kalman_ros.control.lqe import lqe
from kalman_ros.control.lqr import cost, lqr
from kalman_ros.control.margins import Margins, margins
from kalman_ros.control.separation import Expectation
from kalman_ros.control.state_space import StateSpace, state_space
from kalman_ros.core import Array

from . import Findings, close, mean_square
from .loops import lqg_loop
from .stability_boundary import Trial, stability_boundary, trial
from .study_run import StudyRun, ran
from .systems import linear

A, B, C = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
ONES = np.ones((2, 2))
#: Rates of the loop in Hz: for costs, and a lower one for margins.
RATE, SLOW = 100.0, 25.0
#: Value of q and of sigma.
STRENGTH = 1.0
#: Scale of the noise in a run for margins; the gains are the same.
SMALL = 1e-8


def study(size: float = 1.0) -> Findings:
    """Compute the margins, measure the cost in 100 s, then look for the upper gain margin."""
    checks = [_published(), measured_cost(max(40.0, 100.0 * size), STRENGTH)]
    small = system(STRENGTH, scale=SMALL, rate=SLOW)
    upper = margins(lqg_loop(scenarios.build(small))).upper_gain.value
    seconds = 20.0
    with StudyRun(small) as run:
        inside, outside = (
            trial(run, 'actuator_gain', 1.0 + share * (upper - 1.0), seconds)
            for share in (0.5, 1.5)
        )
        boundary, _ = stability_boundary(run, 'actuator_gain', 1.0, 1.04, seconds)
    outcomes = float(inside.rate < 0.0 < outside.rate)
    checks += [
        # of the margin beyond 1: the search stops within 0.3 %
        close('LQG: gain over topics', '', upper, boundary, 0.1 * (upper - 1.0)),
        close('stable half way to it, unstable half as far again', '', 1.0, outcomes, 0.0),
    ]
    return Findings(checks, lambda path: _draw((inside, outside), (upper, boundary), path))


def system(
    strength: float, scale: float = 1.0, rate: float = RATE, **others: Any
) -> dict[str, Any]:
    """Return Doyle's plant, with q = sigma = ``strength``; V = 1 is divided among samples."""
    return linear(
        {'x1': '', 'x2': ''}, A, B, scale**2 * strength * ONES, C, [scale * sqrt(rate)],
        **{
            'rate': rate, 'reading__rate': rate, 'filter': 'steady_state',
            'state_cost': (strength * ONES).ravel().tolist(), 'initial_state': [1.0, 0.0],
            **others,
        },
    )  # fmt: skip


def measured_cost(seconds: float, strength: float, **others: Any) -> Check:
    """Compare the cost over topics with theory, sampled; the bounds are its scatter."""
    parameters = system(
        strength, initial_std=[3.0, 3.0], **{'initial_state': [0.0, 0.0], **others}
    )
    scenario = scenarios.build(parameters)
    expected = theory(scenario)
    settled = expected.settling_time
    trajectory = ran(parameters, seconds=settled + seconds)
    z = np.hstack((trajectory.truth, trajectory.input))[trajectory.time >= settled]
    weight = expected.cost.weight
    value = float(np.mean(np.einsum('ki,ij,kj->k', z, weight, z))) * RATE
    average = expected.loop.average(expected.loop.cost_weight(expected.cost)[None], len(z))[0]
    name = f'cost of LQG, sampled (continuous: {published_cost(strength):.1f})'
    per_second = Expectation(average.mean * RATE, average.std * RATE)
    return mean_square(name, '1/s', per_second, value)


def published_cost(strength: float) -> float:
    """Return 5 f (sigma + f d) for q = sigma = ``strength``."""
    f = d = 2.0 + sqrt(4.0 + strength)
    return 5.0 * f * (strength + f * d)


def continuous_margins(strength: float) -> tuple[Margins, Margins]:
    """Return the margins of the regulator and of LQG, in continuous time."""
    plant = state_space(A, B, C)
    K = lqr(A, B, cost(strength * ONES, [1.0], (2, 1))).gain
    L = lqe(A, C, strength * ONES, np.eye(1)).gain
    regulator = StateSpace(A, B, K, np.zeros((1, 1)))
    return margins(regulator), margins(compensator(plant, K, L) @ plant)


def _published() -> Check:
    """Compare the margin with the published number for q = sigma = 1."""
    upper = continuous_margins(1.0)[1].upper_gain.value
    return close('LQG: continuous gain margin, published', '', 1.05573, upper, 5e-6)


def _draw(sides: tuple[Trial, Trial], boundaries: tuple[float, float], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, picture

    strengths: Array = np.asarray(np.geomspace(0.1, 1e4, 60), dtype=float)
    pairs = [continuous_margins(strength) for strength in strengths.tolist()]
    with picture(path, 1, 2, (9.0, 3.3)) as (_, ((axis, sizes),)):
        axis.plot(
            strengths, [lqg.upper_gain.value - 1.0 for _, lqg in pairs],
            color=ESTIMATE, label='LQG: more gain',
        )  # fmt: skip
        axis.plot(
            strengths, [1.0 - lqg.lower_gain.value for _, lqg in pairs], '--',
            color=ESTIMATE, label='LQG: less gain',
        )  # fmt: skip
        axis.plot(
            strengths, [1.0 - known.lower_gain.value for known, _ in pairs], '--',
            color=TRUTH, label='LQR: less gain',
        )  # fmt: skip
        axis.axhline(0.5, color=READING, lw=3, alpha=0.5, zorder=0, label='guarantee for LQR')
        axis.plot(
            [STRENGTH],
            [boundaries[1] - 1.0],
            'o',
            color=INPUT,
            ms=6,
            label=f'LQG measured, {SLOW:g} Hz',
        )
        axis.set_xscale('log')
        axis.set_yscale('log')
        axis.set_xlabel('weight of the state, and density of the noise')
        axis.set_ylabel('gain margin, part of the gain (log)')
        axis.set_title('The stronger, the smaller the margin of LQG')
        axis.legend(loc='lower left')
        for side, colour in zip(sides, (ESTIMATE, INPUT)):
            sizes.plot(side.time, side.size, color=colour, label=f'gain x {side.value:.3f}')
        sizes.set_yscale('log')
        sizes.set_ylabel('norm of the state (log)')
        sizes.set_title(f'The margin is x {boundaries[0]:.3f}')
        sizes.legend()
