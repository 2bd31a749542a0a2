# SPDX-License-Identifier: Apache-2.0
"""No other gains cost less than LQG; the cost is as predicted.

The regulator is designed for another weight of the input, then the estimator for another process
noise; the true cost is unchanged. All runs have the same noise, so that small differences show.
Most runs use one process; some are repeated over topics, with equal results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.analysis.checks import MISS, Check, theory
from kalman_ros.control.performance import stationary_cost
from kalman_ros.control.separation import optimal_cost
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import Array
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import feedback, price, regulator
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close
from .loops import controller
from .study_run import ran
from .systems import linear

FACTORS = (1 / 30, 1.0, 30.0)
RATE = 20.0
SECONDS, SETTLED = 25.0, 5.0
#: Allowed difference from a `Run` over topics, due to rounding.
SAME = 1e-9


@dataclass(frozen=True)
class Variant:
    """Gains designed for a modified system, and their cost."""

    kind: str
    factor: float
    expected: float
    costs: Array


def study(size: float = 1.0) -> Findings:
    """Measure the cost of five pairs of gains with the same 40 seeds."""
    seeds = range(max(12, round(40 * size)))
    real = scenarios.build(system())
    variants, checks = [], []
    for kind in ('K', 'L'):
        for factor in FACTORS:
            if (kind, factor) == ('L', 1.0):
                continue  # as K
            believed = scenarios.build(system(**{kind: factor}))
            runs = [_run(real, believed, seed) for seed in seeds]
            costs = np.array([_cost(real, run) for run in runs])
            variants.append(Variant(kind, factor, expected_cost(real, believed), costs))
            if factor >= 1.0:
                gap = _gap(runs[0], kind, factor)
                name = f'{kind} for x{factor:g}: largest gap over topics'
                checks.append(between(name, '', 0.0, gap, SAME))
    checks += _checks(real, variants)
    return Findings(checks, lambda path: _draw(variants, path))


def system(K: float = 1.0, L: float = 1.0) -> dict[str, Any]:
    """Return an oscillator whose regulator or estimator is designed for another system."""
    return linear(
        {'position': 'm', 'velocity': 'm/s'}, [[0, 1], [-1, 0]], [[0], [1]], [0, L], [[1, 0]],
        [0.5], rate=RATE, reading__rate=RATE, state_cost=[4.0, 1.0], input_cost=[0.5 * K],
        filter='steady_state', initial_std=[0.3, 0.5],
    )  # fmt: skip


def expected_cost(real: Scenario, believed: Scenario) -> float:
    """Return the cost per second, in steady state, of gains designed for another system."""
    loop = theory(real).loop
    step, readings, dt = loop.step, loop.schedule[0], 1.0 / real.rate
    D = np.zeros((len(readings.C), step.G.shape[1]))
    plant = StateSpace(step.F, step.G, readings.C, D, dt)
    return stationary_cost(plant, controller(believed), step.Q, readings.R, price(real)) / dt


def least_cost(real: Scenario) -> float:
    """Return the optimal cost per second, tr(S Q) + tr(K'(R + G'S G) K P), over dt."""
    design, weights = regulator(real)
    loop = theory(real).loop
    sample = optimal_cost(loop.step, design.gain, design.cost_to_go, weights, loop.posterior)
    return sample * real.rate


def _run(real: Scenario, believed: Scenario, seed: int) -> Trajectory:
    gain = feedback(believed).gain
    return closed_loop.run(real, gain, SECONDS, seed, believed=believed)


def _cost(real: Scenario, run: Trajectory) -> float:
    """Return the cost per second after the start."""
    z = np.hstack((run.truth, run.input))[run.time >= SETTLED]
    return float(np.mean(np.einsum('ki,ij,kj->k', z, price(real).weight, z)) * real.rate)


def _gap(expected: Trajectory, kind: str, factor: float) -> float:
    """Return the difference of a run over topics from one in a single process."""
    node = {'K': 'controller', 'L': 'estimator'}[kind]
    only: Mapping[str, Any] = {node: system(**{kind: factor})}
    trajectory = ran(system(), only=only, seconds=SECONDS)
    pairs = ((trajectory.truth, expected.truth), (trajectory.input, expected.input))
    return max(float(np.max(np.abs(a[: len(b)] - b[: len(a)]))) for a, b in pairs)


def _checks(real: Scenario, variants: Sequence[Variant]) -> list[Any]:
    """Compare mean costs with theory; differences are tested run by run, so noise cancels."""
    checks = []
    best = variants[FACTORS.index(1.0)]
    n = len(best.costs)
    loop = theory(real)
    weight = loop.loop.cost_weight(loop.cost)[None]
    steps = round((SECONDS - SETTLED) * real.rate) + 1
    scatter = loop.loop.average(weight, steps)[0].std * real.rate
    low, high = chi_square_bounds(best.expected, scatter**2 / n, MISS)
    measured = float(best.costs.mean())
    checks.append(Check.within('cost of LQG', '1/s', least_cost(real), measured, low, high))
    for variant in variants:
        if variant.factor == 1.0:
            continue
        more = variant.costs - best.costs
        # 4.5 standard errors of the differences: a correct one fails in 1e-4 with 40 runs
        tolerance = 4.5 * float(more.std(ddof=1) / np.sqrt(n))
        expected = variant.expected - best.expected
        name = f'{variant.kind} for x{variant.factor:g}: costs more by'
        checks.append(close(name, '1/s', expected, float(more.mean()), tolerance))
    return checks


def _draw(variants: Sequence[Variant], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, TRUTH, legend_below, picture

    with picture(path, 1, 2, (9.0, 3.4)) as (figure, (axes,)):
        for axis, kind, colour in zip(axes, 'KL', (INPUT, ESTIMATE)):
            of = [variant for variant in variants if kind == variant.kind or variant.factor == 1.0]
            fine = np.geomspace(FACTORS[0], FACTORS[-1], 41)
            real = scenarios.build(system())
            curve = [
                expected_cost(real, scenarios.build(system(**{kind: f}))) for f in fine.tolist()
            ]
            axis.plot(fine, curve, color=colour, lw=1.2, label='theory')
            error = [2 * variant.costs.std(ddof=1) / np.sqrt(len(variant.costs)) for variant in of]
            axis.errorbar(
                [variant.factor for variant in of], [variant.costs.mean() for variant in of],
                error,
                fmt='o', color=TRUTH, ms=4, capsize=3, label='measured, 2 standard errors',
            )  # fmt: skip
            axis.set_xscale('log')
            axis.margins(y=0.1)
        axes[0].set_xlabel('input weight that K is designed for / true one')
        axes[1].set_xlabel('process noise that L is designed for / true one')
        axes[0].set_ylabel('cost [1/s]')
        axes[0].set_title('Another regulator costs more')
        axes[1].set_title('Another estimator costs more')
        axes[1].sharey(axes[0])
        legend_below(figure, axes[0])
