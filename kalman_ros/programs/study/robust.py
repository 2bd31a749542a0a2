# SPDX-License-Identifier: Apache-2.0
"""LQG is best for the plant that it believes, and may lose any other; robustness has a price.

Two masses with a spring between them; the first is pushed, the position of the second is
measured. The spring may be softer or stiffer than believed, the load lighter or heavier (B. Wie
and D. Bernstein, J. Guidance, Control and Dynamics 15(5), 1992). The designs: LQG; LQG with
recovery; H-infinity loop shaping; and LQG with fictitious noise where the spring acts (M. Tahk
and J. Speyer, IEEE Trans. Automatic Control 32(9), 1987).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.worst_case import Plant, PlantLoops, WorstCases, worst_cases
from kalman_ros.control.loop_shaping import loop_shaping
from kalman_ros.control.margins import margins
from kalman_ros.control.state_space import state_space
from kalman_ros.core import About, Array, DesignError, LinearSystem, Space, semidefinite
from kalman_ros.scenario import Scenario, build
from kalman_ros.scenario.regulator import price

from . import Findings, between, close, mean_square
from .loops import average
from .stability_boundary import growth_rate
from .study_run import ran

#: Rate of the loop and of the readings, in Hz.
RATE = 20.0
#: Believed values and intervals of the spring in N/m and of the load in kg.
BOX = {'spring': (1.0, 0.7, 1.5), 'load': (1.0, 0.9, 1.1)}
#: Spectral density of the random accelerations in m^2/s^3, and deviation of a reading in m.
NOISE, SIGMA = (0.0, 0.0, 0.01, 1e-4), 0.01 * float(np.sqrt(RATE))
_C = np.array([[0.0, 1.0, 0.0, 0.0]])
#: Scale of the noise, and seconds, of a run in which the growth of an unstable loop is measured.
SMALL, GROWING = 1e-8, 60.0


def two_masses(
    spring: Annotated[float, About('stiffness of the spring', 'N/m', minimum=0.0)] = 1.0,
    load: Annotated[float, About('mass of the load', 'kg', minimum=1e-9)] = 1.0,
    noise_density: Annotated[
        Sequence[float], About('spectral density of the noise: the diagonal, or row by row')
    ] = NOISE,
) -> LinearSystem:
    """Return x1'' = k (x2 - x1) + f, m x2'' = k (x1 - x2), with random accelerations."""
    return LinearSystem(
        A=[
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-spring, spring, 0.0, 0.0],
            [spring / load, -spring / load, 0.0, 0.0],
        ],
        B=[[0.0], [0.0], [1.0], [0.0]],
        W=semidefinite('noise_density', np.array(noise_density), 4),
        state=Space(('x1', 'x2', 'v1', 'v2'), ('m', 'm', 'm/s', 'm/s')),
        input=Space(('f',), ('N',)),
    )


def system(scale: float = 1.0, **others: Any) -> dict[str, Any]:
    """Return the parameters of the LQG loop, with its noise scaled."""
    return {
        'model': f'{__name__}:two_masses',
        'model_parameters.noise_density': [scale**2 * density for density in NOISE],
        'sensors': ['reading'],
        'reading.kind': 'linear',
        'reading.C': _C.ravel().tolist(),
        'reading.noise': [scale * SIGMA],
        'reading.rate': RATE,
        'reading.topic': 'reading',
        'reading.type': 'sensor_msgs/JointState',
        'reading.fields': ['position[y]'],
        'state.topic': 'estimate',
        'state.type': 'sensor_msgs/JointState',
        'state.fields': [f'position[{name}]' for name in ('x1', 'x2', 'v1', 'v2')],
        'input.topic': 'command',
        'input.type': 'sensor_msgs/JointState',
        'input.fields': ['effort[f]'],
        'rate': RATE,
        'filter': 'steady_state',
        'state_cost': (_C.T @ _C).ravel().tolist(),
        'input_cost': [1.0],
        'initial_state': [0.0] * 4,
        'initial_estimate': [0.0] * 4,
        'initial_std': [1.0] * 4,
        **others,
    }


@cache
def designs() -> Mapping[str, dict[str, Any]]:
    """Return what each design changes in estimator and controller, by its name.

    The free numbers are the ones with the least worst cost on a grid; of recovery, which has none
    that is stable in the whole box, the one that is used by the study `recovery`.
    """
    plant, W = two_masses(), np.diag(NOISE)
    shaped = loop_shaping(
        state_space(plant.A, plant.B, _C), np.array([[30.0]]), np.eye(1), beyond=1.5
    )
    spring = np.array([[0.0], [0.0], [-1.0], [1.0]])
    density = SIGMA**2 / RATE

    def noise(matrix: Array) -> dict[str, Any]:
        return {'model_parameters.noise_density': np.asarray(matrix).ravel().tolist()}

    return {
        'LQG': {},
        'recovered': noise(W + 1.0 * plant.B @ plant.B.T),
        'loop shaping': {**noise(density * shaped.noise), 'input_cost': [30.0]},
        'spring-aware': noise(W + 0.04 * spring @ spring.T),
    }


def scenario(name: str, scale: float = 1.0) -> Scenario:
    """Return the scenario that a design believes."""
    return build({**system(scale), **_scaled(designs()[name], scale)})


def plants(at: Array) -> Plant:
    """Return the real plant with a spring and a load."""
    names = (f'model_parameters.{name}' for name in BOX)
    return Plant(build(system(**dict(zip(names, at.tolist())))))


def worst(name: str) -> WorstCases:
    """Return the worst case of a design over the box, at the cost of the task."""
    return worst_cases(scenario(name), plants, BOX, price(scenario('LQG')))


def study(size: float = 1.0) -> Findings:
    """Bound each design over the box, and measure it with the plant at its worst point."""
    cases = {name: worst(name) for name in designs()}
    stable = [name for name, case in cases.items() if np.isfinite(case.cost.reached)]
    unstable = [name for name in cases if name not in stable]
    seconds = max(60.0, 600.0 * size)
    checks = [
        *(_bounded(name, cases[name]) for name in stable),
        *(_measured_cost(name, cases[name], seconds) for name in stable),
        *(_measured_growth(name, cases[name]) for name in unstable),
        between(
            'disk margin, recovered over LQG', '', 1.0,
            _disk('recovered') / _disk('LQG'), np.inf,
        ),
    ]  # fmt: skip
    return Findings(checks, lambda path: _draw(cases, checks, path))


def _bounded(name: str, case: WorstCases) -> Check:
    ratio = case.cost.bound / case.cost.reached
    return between(f'{name}: bound of the cost over the worst found', '', 1.0, ratio, 1.1)


def _disk(name: str) -> float:
    believed = scenario(name)
    loop = PlantLoops(believed, lambda at: Plant(believed)).broken(np.zeros(1), 0)
    return margins(loop).disk.alpha


def _measured_cost(name: str, case: WorstCases, seconds: float) -> Check:
    """Compare the cost over topics, with the plant at its worst, with theory."""
    weights = price(scenario('LQG')).weight
    loops = PlantLoops(scenario(name), plants)
    real = plants(case.cost.point).scenario
    settled = 60.0
    z = _run(name, case.cost.point, 1.0, settled + seconds)[round(settled * RATE) :]
    expected = average(real, RATE * weights, len(z), loops.controller)
    value = RATE * float(np.mean(np.einsum('ki,ij,kj->k', z, weights, z)))
    return mean_square(f'{name}: cost at its worst', '1/s', expected, value)


def _measured_growth(name: str, case: WorstCases) -> Check:
    """Compare the growth of an unstable loop over topics with theory."""
    point = case.cost.point
    loop = PlantLoops(scenario(name), plants).noisy(point)
    growth = RATE * float(np.log(np.abs(np.linalg.eigvals(loop.A)).max()))
    states = _run(name, point, SMALL, GROWING)[:, :4]
    measured = growth_rate(states[len(states) // 2 :], 1.0 / RATE)
    return close(f'{name}: growth at its worst', '1/s', growth, measured, 0.05 * growth)


def _run(name: str, point: Array, scale: float, seconds: float) -> Array:
    """Return states and inputs (N, n + m) of the nodes with the plant at a point."""
    changes = _scaled(designs()[name], scale)
    noise = {key: value for key, value in changes.items() if key.startswith('model_parameters')}
    rest = {key: value for key, value in changes.items() if key not in noise}
    real = {f'model_parameters.{k}': v for k, v in zip(BOX, point.tolist())}
    start = [1.0, 1.0, 0.0, 0.0] if scale < 1.0 else [0.0] * 4
    only = {'plant': real, 'estimator': noise, 'controller': {**noise, **rest}}
    parameters = system(scale, initial_state=start)
    trajectory = ran(parameters, only=only, seconds=seconds)
    return np.hstack((trajectory.truth, trajectory.input))


def _scaled(changes: Mapping[str, Any], scale: float) -> dict[str, Any]:
    """Return the changes of a design whose noise is scaled."""
    key = 'model_parameters.noise_density'
    if key not in changes:
        return dict(changes)
    return {**changes, key: [scale**2 * number for number in changes[key]]}


def _draw(cases: Mapping[str, WorstCases], checks: Sequence[Check], path: Path) -> None:
    from kalman_ros.report.style import BOUND, ESTIMATE, INPUT, READING, TRUTH, allowed, picture

    colours = dict(zip(cases, (TRUTH, READING, ESTIMATE, INPUT)))
    springs: Array = np.asarray(np.geomspace(0.4, 2.5, 121), dtype=float)
    weights = price(scenario('LQG'))
    by_name = {check.name: check for check in checks}
    with picture(path, 1, 2, (9.0, 3.6)) as (_, ((cost, bars),)):
        for name, case in cases.items():
            loops = PlantLoops(scenario(name), plants, weights)
            at = float(case.cost.point[1])
            costs = [_cost(loops, np.array([k, at])) for k in springs.tolist()]
            cost.plot(springs, costs, color=colours[name], label=name)
            if (check := by_name.get(f'{name}: cost at its worst')) is not None:
                place = [float(case.cost.point[0])]
                allowed(cost, place, [check], colours[name])
                cost.plot(place, [check.measured.real], 'o', color=colours[name], ms=6)
        low, high = BOX['spring'][1:]
        cost.axvspan(low, high, color=BOUND, alpha=0.12, lw=0)
        cost.set(
            xscale='log', yscale='log', ylim=(0.04, 8.0), xlabel='spring [N/m] (log)',
            ylabel='cost a second (log)', title='Where a curve ends the loop is unstable',
        )  # fmt: skip
        cost.set_xticks([0.5, 0.7, 1.0, 1.5, 2.0], ['0.5', '0.7', '1', '1.5', '2'])
        cost.minorticks_off()
        cost.legend(loc='upper center', ncols=2)
        rows = np.arange(len(cases))
        disks = [_disk(name) for name in cases]
        proved = [case.stability.proved for case in cases.values()]
        bars.barh(rows - 0.2, disks, 0.36, color=READING, label='disk margin', zorder=2)
        bars.barh(rows + 0.2, proved, 0.36, color=INPUT, label='stable intervals, times', zorder=2)
        bars.axvline(1.0, color=BOUND, lw=1.0, ls=':', zorder=3)
        bars.set_yticks(rows, list(cases))
        bars.invert_yaxis()
        bars.set(xlabel='disk margin; multiple of the intervals', title='What a design survives')
        bars.legend(loc='upper right')


def _cost(loops: PlantLoops, at: Array) -> float:
    try:
        return loops.noisy(at).cost * RATE
    except DesignError:
        return float('nan')
