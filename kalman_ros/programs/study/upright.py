# SPDX-License-Identifier: Apache-2.0
"""The weights set priorities: upright before depth, or not.

The submersible starts tilted and too deep, twice, with the same thrusters and another state
cost. The duration of each displacement is the integral of its square, relative to that of the
start, and is predicted from the gain by a Lyapunov equation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.control.lqr import Cost
from kalman_ros.core import Array, linearize
from kalman_ros.scenario import Scenario, build
from kalman_ros.scenario.regulator import feedback

from . import Findings, between, close
from .cost_to_rest import price
from .study_run import ON_TRUTH, ran

#: x, z, pitch and their rates: the default weights, and the reverse.
WEIGHTS: Mapping[str, list[float]] = {
    'upright first': [1.0, 1.0, 1000.0, 1.0, 1.0, 10.0],
    'depth first': [1.0, 1000.0, 1.0, 1.0, 10.0, 1.0],
}
START = np.array([0.0, -0.05, 0.0125, 0.0, 0.0, 0.0])
#: The index of each displacement in the state.
PLACES = {'depth': 1, 'pitch': 2}
DT, DURATION = 0.02, 30.0
#: Nonlinear terms, products of velocities and of pitch, are less than this share of the linear
#: ones for a start as small as this; drag is linear here.
BENT = 0.03


@dataclass(frozen=True)
class Descent:
    """The result of a set of weights: the path, and the duration of each displacement."""

    truth: Array
    input: Array
    expected: Mapping[str, float]
    tolerance: Mapping[str, float]

    def lasted(self, name: str) -> float:
        """Return the integral of a displacement's square over that of its start, in s."""
        place = PLACES[name]
        return float(np.sum(self.truth[:, place] ** 2) * DT / START[place] ** 2)


def study(size: float = 1.0) -> Findings:
    """Run for 30 s with each cost, or less at a smaller size."""
    duration = max(10.0, DURATION * size)
    descents = {name: _run(weights, duration) for name, weights in WEIGHTS.items()}
    checks = []
    for name, run in descents.items():
        for displacement in PLACES:
            numbers = (
                run.expected[displacement],
                run.lasted(displacement),
                run.tolerance[displacement],
            )
            checks.append(close(f'{displacement} lasts, {name}', 's', *numbers))
    upright, deep = descents.values()
    gains = deep.lasted('pitch') / upright.lasted('pitch')
    losses = upright.lasted('depth') / deep.lasted('depth')
    checks.append(between('pitch lasts longer with depth first', '', 2.0, gains, np.inf))
    checks.append(between('depth lasts longer with upright first', '', 2.0, losses, np.inf))
    data = {'weights': dict(WEIGHTS), 'start': START.tolist()}
    return Findings(checks, lambda path: _draw(descents, path), data)


def _values(weights: list[float]) -> dict[str, Any]:
    still = {'force_noise': 1e-12, 'moment_noise': 1e-12}
    bends = {'quadratic_drag': 0.0, 'quadratic_angular_drag': 0.0}
    return {
        'model': 'submersible',
        'rate': 1.0 / DT,
        'imu.rate': 1.0 / DT,
        'state_cost': weights,
        'initial_state': START.tolist(),
        **{f'model_parameters.{name}': value for name, value in {**still, **bends}.items()},
    }


def _run(weights: list[float], duration: float) -> Descent:
    values = _values(weights)
    trajectory = ran(values, remaps=ON_TRUTH, seconds=duration)
    expected, tolerance = _theory(build(values), len(trajectory.truth))
    return Descent(trajectory.truth, trajectory.input, expected, tolerance)


def _theory(scenario: Scenario, steps: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return how long each displacement lasts by the linear loop, and the tolerances."""
    step = linearize(scenario.model, *scenario.model.equilibrium).sampled(DT)
    gain = feedback(scenario).gain
    expected, tolerance = {}, {}
    for name, place in PLACES.items():
        square = np.zeros((6, 6))
        square[place, place] = DT / START[place] ** 2
        cost = Cost(square, np.zeros((3, 3)), np.zeros((6, 3)))
        expected[name], scatter = price(step, gain, cost, START, steps)
        tolerance[name] = scatter + BENT * expected[name]
    return expected, tolerance


def _draw(descents: Mapping[str, Descent], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, picture

    with picture(path, 1, 3, (9.0, 2.6)) as (_, ((depth, pitch, thrust),)):
        for (name, run), colour in zip(descents.items(), (ESTIMATE, INPUT)):
            time = np.arange(len(run.truth)) * DT
            depth.plot(time, run.truth[:, 1], color=colour, label=name)
            pitch.plot(time, run.truth[:, 2], color=colour, label=name)
            thrust.plot(time, run.input[:, 1], color=colour, label=f'{name}, fore')
            thrust.plot(time, run.input[:, 2], '--', color=colour, label=f'{name}, aft')
        depth.set_title('Depth')
        depth.set_ylabel('z [m]')
        depth.set_xlim(0.0, 10.0)
        depth.legend(loc='lower right')
        pitch.set_title('Pitch')
        pitch.set_ylabel('pitch [rad]')
        pitch.set_xlim(0.0, 10.0)
        thrust.set_title('Thrusters')
        thrust.set_ylabel('force [N]')
        thrust.set_xlim(0.0, 4.0)
        thrust.legend(loc='upper right', fontsize=7)
