# SPDX-License-Identifier: Apache-2.0
"""Weights off the diagonal price products: some do nothing, others make carts meet.

On one cart q_xv weighs x v, half the change of x^2, which adds up to a constant: the gain is
the same. N weighs x u, which by parts is the same as less weight on v^2. Between two carts a
weight on their distance is off the diagonal, and the second cart comes to meet the first.
One controller holds all seven carts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.analysis.checks import Check
from kalman_ros.control.lqr import Cost, sampled_cost, sampled_lqr
from kalman_ros.core import Array
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close
from .cost_to_rest import price
from .study_run import ON_TRUTH, ran
from .systems import carts, plant

DT, SECONDS = 0.05, 12.0
#: q_xv of the second cart; N of the third; the weight of the distance of the last two.
ALONG, CROSS, DISTANCE = 0.8, 0.5, 4.0
APART = np.asarray(DISTANCE * np.kron([[1.0, -1.0], [-1.0, 1.0]], np.diag([1.0, 0.0])))
WEIGHT = block_diag(
    np.eye(2),
    [[1.0, ALONG], [ALONG, 1.0]],
    np.diag([1.0, 1.0 - 2.0 * CROSS]),  # as N = (CROSS, 0) with ones on the diagonal
    np.eye(4),
    np.eye(4) + APART,
)
PLAIN, WITH_XV, WITH_N, ALONE, TOGETHER = (
    slice(0, 2), slice(2, 4), slice(4, 6), slice(6, 10), slice(10, 14),
)  # fmt: skip
START = np.array([1.0, 0.0] * 4 + [0.0, 0.0] + [1.0, 0.0] + [0.0, 0.0])
SYSTEM = carts(
    7, [0.0, 1e-20], 0.01, 1.0 / DT, state_cost=WEIGHT.ravel().tolist(), input_cost=[1.0] * 7,
    initial_state=START.tolist(),
)  # fmt: skip
ROUNDING = 1e-8


def study(size: float = 1.0) -> Findings:
    """Run all carts for 12 s, until they are at rest."""
    trajectory = ran(SYSTEM, remaps=ON_TRUTH, seconds=SECONDS)
    checks = [
        *_along_checks(trajectory),
        *_cross_checks(trajectory),
        *_distance_checks(trajectory),
    ]
    return Findings(checks, lambda path: _draw(trajectory, path))


def _cost(state: Array, cross: Array) -> Cost:
    return Cost(state, np.eye(cross.shape[1]), cross)


def _along_checks(run: Trajectory) -> list[Check]:
    """Compare the carts with and without q_xv, and their costs."""
    paths = [run.truth[:, part] for part in (PLAIN, WITH_XV)]
    gap = float(np.abs(paths[0] - paths[1]).max())
    one = plant(carts(1, [0.0, 1e-20], 0.01, 1.0 / DT))
    weights = [
        sampled_cost(one, _cost(Q, np.zeros((2, 1))), DT).weight
        for Q in (WEIGHT[PLAIN, PLAIN], WEIGHT[WITH_XV, WITH_XV])
    ]
    z = np.hstack((paths[1], run.input[:, [1]]))
    paid = [float(np.einsum('ki,ij,kj->', z, weight, z)) for weight in weights]
    return [
        close('q_xv: change of the path', 'm', 0.0, gap, ROUNDING),
        close('q_xv: change of the cost, -q x_0^2', '', -ALONG, paid[1] - paid[0], 1e-6),
    ]


def _cross_checks(run: Trajectory) -> list[Check]:
    """Compare the third cart with the regulator of N, and its cost with the first cart's."""
    one = plant(carts(1, [0.0, 1e-20], 0.01, 1.0 / DT))
    with_n = _cost(np.eye(2), np.array([[CROSS], [0.0]]))
    step, K = one.sampled(DT), sampled_lqr(one, with_n, DT).gain
    path = [START[WITH_N]]
    for _ in run.time[1:]:
        path.append((step.F - step.G @ K) @ path[-1])
    gap = float(np.abs(run.truth[:, WITH_N] - np.array(path)).max())
    weight = sampled_cost(one, with_n, DT).weight
    paid = [
        float(np.einsum('ki,ij,kj->', z, weight, z))
        for z in (np.hstack((run.truth[:, part], run.input[:, [k]]))
                  for part, k in ((WITH_N, 2), (PLAIN, 0)))
    ]  # fmt: skip
    return [
        close('N: path by the regulator of N, off', 'm', 0.0, gap, ROUNDING),
        between('N: price of ignoring it', '%', 1.0, 100.0 * (paid[1] / paid[0] - 1.0), np.inf),
    ]


def _distance_checks(run: Trajectory) -> list[Check]:
    """Compare the integral of the squared distance with the Lyapunov equation."""
    two = plant(carts(2, [0.0, 1e-20], 0.01, 1.0 / DT))
    step, gaps = two.sampled(DT), {}
    checks = []
    for name, part in (('alone', ALONE), ('together', TOGETHER)):
        K = sampled_lqr(two, _cost(WEIGHT[part, part], np.zeros((4, 2))), DT).gain
        square = Cost(np.asarray(DT / DISTANCE * APART), np.zeros((2, 2)), np.zeros((4, 2)))
        expected, tolerance = price(step, K, square, START[part], len(run.time))
        x = run.truth[:, part]
        gaps[name] = DT * float(np.sum((x[:, 0] - x[:, 2]) ** 2))
        checks.append(close(f'{name}: squared distance', 'm^2 s', expected, gaps[name], tolerance))
    still, meets = (float(np.abs(run.truth[:, k]).max()) for k in (8, 12))
    return [
        *checks,
        close('alone: the second cart moves by', 'm', 0.0, still, ROUNDING),
        between('together: it comes to meet by', 'm', 0.1, meets, 1.0),
    ]


def _draw(run: Trajectory, path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with

    with figure_with(path, 1, 2, (9.0, 3.2)) as (_, ((one, two),)):
        one.plot(run.time, run.truth[:, 0], color=TRUTH, lw=2.6, label='diagonal')
        one.plot(run.time, run.truth[:, 2], '--', color=ESTIMATE, label='with q_xv = 0.8')
        one.plot(run.time, run.truth[:, 4], color=INPUT, label='with N = (0.5, 0)')
        one.set(title='One cart', ylabel='x [m]', xlabel='time [s]', xlim=(0.0, 8.0))
        one.legend(loc='upper right')
        for part, colour, label in ((ALONE, READING, 'alone'), (TOGETHER, ESTIMATE, 'together')):
            first, second = run.truth[:, part][:, [0, 2]].T
            two.plot(run.time, first, color=colour, label=f'{label}, first')
            two.plot(run.time, second, '--', color=colour, label=f'{label}, second')
        two.set(title='Two carts, with a weight on their distance', ylabel='x [m]',
                xlabel='time [s]', xlim=(0.0, 8.0))  # fmt: skip
        two.legend(loc='upper right', fontsize=8)
