# SPDX-License-Identifier: Apache-2.0
"""Weights trade error for energy on a curve that none can beat.

Identical carts start together, as one system with one regulator. Their weights of the
input differ; since they are independent, the regulator of all is the regulator of each. Three
more carts, one after the other, have their poles placed instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.control.lqr import Cost, LqrDesign, cost, sampled_cost, sampled_lqr
from kalman_ros.core import Array
from kalman_ros.linear.placement import sampled_place
from kalman_ros.linear.structure import describe

from . import Findings, between, close
from .cost_to_rest import price
from .study_run import ON_TRUTH, ran
from .systems import cart, carts, plant

#: Weights Q_u of u^2 beside a weight 1 of x^2.
WEIGHTS = (0.001, 0.01, 0.1, 1.0, 10.0)
#: Plausible poles in 1/s: slow and oscillating, one slow, both fast.
PLACED = ((-0.5 + 2.0j, -0.5 - 2.0j), (-0.7, -5.0), (-4.0, -6.0))
START = np.array([1.0, 0.0])
DT, DURATION = 0.02, 20.0
#: Process noise, which sets the tolerances; noise of the reading, which is unused.
CART = ([1e-12, 1e-12], 0.01, 1.0 / DT)
PLANT = plant(cart(*CART))
#: Costs that integrate x^2 and u^2 over a sample, in which the input is held.
INTEGRALS = tuple(
    sampled_cost(PLANT, Cost(np.diag([1.0 - k, 0.0]), np.array([[k]]), np.zeros((2, 1))), DT)
    for k in (0.0, 1.0)
)


@dataclass(frozen=True)
class Point:
    """The cost of a gain: the integrals of x^2 and u^2, with their theory and tolerances."""

    name: str
    measured: Array
    expected: Array
    tolerance: Array

    def cost(self, weight: float) -> float:
        """Return the measured cost with a weight Q_u of the input."""
        return float(self.measured[0] + weight * self.measured[1])

    @property
    def checks(self) -> list[Check]:
        """Comparisons of both integrals with theory."""
        names = (('x^2', 'm^2 s'), ('u^2', 'm^2/s^3'))
        return [
            close(f'{name}, {self.name}', unit, *numbers)
            for (name, unit), *numbers in zip(names, self.expected, self.measured, self.tolerance)
        ]


def study(size: float = 1.0) -> Findings:
    """Run the carts for 20 s each."""
    curve = _optimal_points()
    placed = [_placed(poles) for poles in PLACED[: max(1, round(len(PLACED) * size))]]
    points = [*curve, *placed]
    checks = [check for point in points for check in point.checks]
    for point in placed:
        # the least cost by Riccati's equation, for the weight most favourable to the point
        excess = min(point.cost(R) / _least(R) for R in WEIGHTS)
        checks.append(between(f'cost / least, {point.name}', '', 1.0, excess, np.inf))
    cheapest = [min(points, key=lambda p: p.cost(R)) is point for R, point in zip(WEIGHTS, curve)]
    checks.append(
        close('weights whose own gain costs least', '', len(WEIGHTS), float(sum(cheapest)), 0.0)
    )
    data = {'points': {point.name: point.measured.tolist() for point in points}}
    return Findings(checks, lambda path: _draw(curve, placed, path), data)


def _optimal_points() -> list[Point]:
    """Return the cost of the optimal gain of each weight, from one run."""
    count = len(WEIGHTS)
    weights: dict[str, Any] = {'state_cost': [1.0, 0.0] * count, 'input_cost': [*WEIGHTS]}
    start = START.tolist() * count
    system = carts(count, *CART, initial_state=start, **weights)
    trajectory = ran(system, remaps=ON_TRUTH, seconds=DURATION)
    # z = (x, u) of each cart, samples first
    x, u = trajectory.truth.reshape(-1, count, 2), trajectory.input.reshape(-1, count, 1)
    z = np.concatenate((x, u), axis=2).swapaxes(0, 1)
    return [_point(f'Q_u = {R:g}', _optimal(R).gain, samples) for R, samples in zip(WEIGHTS, z)]


def _placed(poles: tuple[complex, complex]) -> Point:
    """Return the cost of poles, from a run."""
    real, imaginary = np.real(poles).tolist(), np.imag(poles).tolist()
    law = {'law': 'placement', 'regulator_poles': real, 'regulator_frequencies': imaginary}
    trajectory = ran(
        cart(*CART, initial_state=START.tolist(), **law), remaps=ON_TRUTH, seconds=DURATION
    )
    gain = sampled_place(PLANT.A, PLANT.B, poles, DT).gain
    return _point(
        f's = {describe(np.array(poles))}', gain, np.hstack((trajectory.truth, trajectory.input))
    )


def _optimal(weight: float) -> LqrDesign:
    return sampled_lqr(PLANT, cost([1.0, 0.0], [weight], (2, 1)), DT)


def _least(weight: float) -> float:
    """Return the least possible cost, x'S x."""
    return float(START @ _optimal(weight).cost_to_go @ START)


def _point(name: str, gain: Array, z: Array) -> Point:
    """Return the integrals along recorded z = (x, u) (N, 3), and those predicted for a gain."""
    measured = [float(np.einsum('ki,ij,kj->', z, integral.weight, z)) for integral in INTEGRALS]
    expected, tolerance = _theory(gain, len(z))
    return Point(name, np.array(measured), expected, tolerance)


def _theory(gain: Array, steps: int) -> tuple[Array, Array]:
    """Return the integrals of x^2 and of u^2 under a gain, and their tolerances."""
    step = PLANT.sampled(DT)
    expected, tolerance = zip(
        *(price(step, gain, integral, START, steps) for integral in INTEGRALS)
    )
    return np.array(expected), np.array(tolerance)


def _draw(curve: list[Point], placed: list[Point], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, TRUTH, picture

    weights = np.geomspace(WEIGHTS[0] / 3.0, WEIGHTS[-1] * 3.0, 60)
    steps = round(DURATION / DT)
    front = np.array([_theory(_optimal(R).gain, steps)[0] for R in weights])
    with picture(path, 1, 1, (6.5, 3.8)) as (_, ((axis,),)):
        axis.fill_between(front[:, 1], front[:, 0], front[:, 0].min(), color='0.93', lw=0)
        axis.loglog(front[:, 1], front[:, 0], color=TRUTH, label='least cost, by Riccati')
        for points, mark, colour, label, side in (
            (curve, 'o', ESTIMATE, 'LQR, measured', -1),
            (placed, 's', INPUT, 'placed poles, measured', 1),
        ):
            at = np.array([point.measured for point in points])
            axis.plot(at[:, 1], at[:, 0], mark, color=colour, label=label)
            for point in points:
                place = point.measured[1], point.measured[0]
                axis.annotate(
                    point.name, place, (5 * side, 5 * side), textcoords='offset points',
                    ha='left' if side > 0 else 'right', va='bottom' if side > 0 else 'top',
                )  # fmt: skip
        axis.set_yticks([0.2, 0.5, 1.0, 2.0], ['0.2', '0.5', '1', '2'])
        axis.minorticks_off()
        axis.set_xlabel('input: integral of u² [m²/s³]')
        axis.set_ylabel('state: integral of x² [m² s]')
        axis.set_title('No feedback reaches the grey area')
        axis.legend(loc='upper right')
